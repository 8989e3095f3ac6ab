# calculix.awk - displacements (*NODE PRINT with U) of CalculiX's .dat as rows, while it grows: time,
# then x, y, z of each node, of all sets printed at that time.
#
#   ccx -i beam & tail -n +1 -F --pid=$! beam.dat | awk -f calculix.awk | modalctl stream - --name beam
#
# A row is complete, and printed, when the next time begins.

function row() {
    if (cells == "") return
    if (!named++) print "time" names
    print time cells
    fflush()
    cells = ""
}
/^ *displacements/ { if ($NF != time) row(); time = $NF; next }
NF == 4 && $1 ~ /^[0-9]+$/ {
    if (!named) names = names "," $1 "x," $1 "y," $1 "z"
    cells = cells "," $2 "," $3 "," $4
}
END { row() }
