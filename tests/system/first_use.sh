#!/bin/bash
# What somebody meets who has the packages and their manual: `== ROW what`, then each command, what
# it says and its status, for test_first_use.py.  Run as root in the folder of the files it takes.
row() { printf '\n== %s\n' "$*"; }
try() {
    printf '$ %s\n' "$*"
    timeout 120 "$@" >said 2>&1 </dev/null; local code=$?
    grep -av '^$' said | cut -c1-250 | head -n 40; echo "[exit $code]"
}
page() {
    printf '$ man %s | grep %s\n' "$1" "$2"
    MANWIDTH=100 man "$1" 2>/dev/null | grep -oE "$2" | sort | uniq -c
}
public() { sed -n 's/^public-key = "\(.*\)"/\1/p' "$1"; }
# daemon LOG WORD...: a daemon that is ready, its process in $daemon
daemon() {
    "${@:2}" 2>"$1" & daemon=$!
    for _ in $(seq 600); do grep -q event=ready "$1" && return; sleep 0.1; done
    cat "$1"
}
L="modalctl --local"

install -d -o modald -g modald -m 750 /run/modald /var/lib/modald
daemon /tmp/log setpriv --reuid modald --regid modald --clear-groups \
    modald --config /etc/modald/modald.conf
first=$daemon

row a1 what the columns and members of a result mean
page modald-result '(mpc|resolved_exponent|clusters|trend|relative_error)'
try modalctl help result mpc
row a2 --dt against the time column of the file
try $L identify plain.csv --dt 0.02
row a3 an ambient record as one, and as it is
try $L identify ambient.csv -o response=ambient
try $L identify ambient.csv
row a4 MATLAB v5 and v7.3, NPY, UFF, OpenFAST
for f in v5.mat v73.mat a.npy a.uff a.out; do try $L identify $f --csv --dt 0.01; done
row a5 own names in HDF5
try $L identify own.h5; try $L identify own.h5 --dataset accel --csv
row a6 an impact after three seconds of quiet
try $L identify hammer.csv -o window=auto
row a7 a steady force in a decay
try $L identify forced.csv
row a8 shapes, and their MAC
try $L identify plain.csv -o shapes=true
modalctl submit identify plain.csv -o shapes=true --key shapes --wait >/dev/null
try modalctl mac key:shapes key:shapes
row a9 a table of modes as CSV, and never HDF5 in a .csv
try $L identify plain.csv --csv; try $L steady duffing.json -O st.csv; head -n 1 st.csv
row a10 the suffix of a picture, and a picture to stdout
try $L identify plain.csv --plot x.png; try $L identify plain.csv --plot -
row a11 the stabilisation picture has a legend
try $L identify plain.csv --plot x.svg; grep -oE '>[^<]*</text>' x.svg | sort -u
row a12 a picture of an earlier result
modalctl submit identify plain.csv --key earlier --wait >/dev/null
try modalctl result key:earlier --plot r.svg; head -c 4 r.svg; echo
row a13 headerless time and signal with --dt
try $L identify bare.csv --dt 0.01 --csv
row b1 the scene language
page modald-scene '(gap|wing|shaft|beam|friction)'; try modalctl help scene gap
row b2 a sweep that says no verb, of a friction scene
try $L sweep sweep.json
row b3 a curve that is stopped keeps its points and says how far it is
printf '$ modalctl steady, ended by SIGINT\n'
$L steady joint.json --continue omega=0.5:3 -O curve.csv >/dev/null 2>said & curve=$!
for _ in $(seq 600); do grep -q running said && break; sleep 0.1; done
kill -INT $curve; wait $curve; echo "[exit $?]"
cat said; wc -l <curve.csv; head -c 30 curve.csv
row b4 Matrix Market
try $L steady market.json
row b5 numpy and scipy.sparse in a scene
try python3 -c 'import modald, numpy as np, scipy.sparse as s
with modald.local() as c:
    two = {"type": "matrices", "M": s.identity(2), "K": np.diag([1.0, 4.0])}
    print(c.steady({"structure": two, "omega": np.float64(0.5),
                    "effects": [{"type": "rayleigh_damping", "alpha": 0.1, "beta": 0}],
                    "excitation": [{"dof": "x1", "k": 1, "cos": np.int64(1)}]})["converged"])'
row c1 the record of a stream that ended
modalctl stream plain.csv --name rig7 --window 100 >/dev/null 2>&1
try modalctl streams; try modalctl identify stream:rig7 --csv
try modalctl export stream:rig7 -O rig7.h5
row c2 c4 the verdict after the close, options and alarms as dictionaries
export MODALD_URL=ipc:///run/modald/modald.ipc
try python3 -c 'import time, modald, numpy as np
with modald.stream("kept", 1, 0.05, window=100, options={"rank.fixed": 2},
                   alarms={"damping_below": 0.02}) as s:
    for i in range(600):
        s.push(np.array([np.exp(-0.01 * i) * np.cos(0.3 * i)])); time.sleep(0.002)
    while s.estimate is None: time.sleep(0.01)
print(s.verdict, s.estimate)'
row c3 c6 a loop in each language, and one that was linked runs
find /usr/share/doc -path '*examples*' \( -name 'loop*' -o -name 'live.py*' \) | sort
cc "$(find /usr/share/doc -name 'loop.c')" -o loop $(pkg-config --cflags --libs modald-stream) -lm
printf '$ ./loop\n'; ./loop >samples; echo "[exit $?]"; wc -c <samples
row c5 watch of a stream that never was
try timeout 9 modalctl watch nosuchstream --timeout 4
row d1 another user, in no group and in modald
try setpriv --reuid nobody --regid nogroup --clear-groups modalctl whoami
try setpriv --reuid nobody --regid modald --clear-groups modalctl whoami
row d2 a wrong key over tcp, and none
mkdir -p lab
modalctl keygen lab/server.key >/dev/null
for key in lab/user.key wrong.key; do
    modalctl keygen $key "$(public lab/server.key)" >/dev/null
done
echo "$(public lab/user.key) ann admin" >lab/keys; chmod 600 lab/keys
printf '%s\n' 'data = lab/data' 'bind = tcp://127.0.0.1:7499' 'server_key = lab/server.key' \
    'keys = lab/keys' 'workers = 1' >lab/modald.conf
daemon lab/log modald --config lab/modald.conf
try modalctl --server tcp://127.0.0.1:7499 --keyfile wrong.key hello
try modalctl --server tcp://127.0.0.1:7499 hello
kill $daemon; wait $daemon
row d3 d4 d5 to install, to upgrade, packages
page modald-lab '(apt|systemctl|groups|upgrade|backup|full)'
dpkg-query -W -f '${Package}\n' '*modal*'
row d6 a full disk is told
page modald-lab 'storage_full'
mkdir -p full; mount -t tmpfs -o size=22m none full; mkdir full/data
daemon full.log modald --data full/data --bind ipc://full.ipc --workers 1
for i in $(seq 40); do
    head -c 1500000 /dev/urandom | od -An -td2 -w8 -v |
        sed 's/^ *//; s/ \+/,/g; 1i a,b,c,d' >noise.csv
    modalctl --server ipc://full.ipc submit identify noise.csv --dt 0.01 -o rank.fixed=2 \
        >said 2>&1 || break
done
cat said; modalctl --server ipc://full.ipc metrics | grep '^modald_storage_full'
grep event=storage_full full.log
kill $daemon; wait $daemon; echo "[exit $?]"; umount full
row d7 the queue of everybody
try modalctl list --newest --user local --state done; try modalctl top --help
row d8 the log says who and how long
for what in 'event=edge.*peer=' 'event=edge.*cpu_s=' event=ready; do grep -m 1 $what /tmp/log; done
row e1 one client in eight threads
try python3 -c 'import concurrent.futures as f, modald
b = modald.read("plain.csv")
with modald.connect() as c, f.ThreadPoolExecutor(8) as p:
    asked = [{"rank.fixed": 2 + 2 * (i % 4)} for i in range(40)]
    print(len(list(p.map(lambda one: c.identify(b, options=one), asked))))'
row e2 a list that is waited for
for i in 1 2 3; do
    printf '{"kind":"identify","file":"plain.csv","key":"k%d",' $i
    printf '"options":{"rank.fixed":%d}}\n' $((2 * i))
done >list.jsonl
try modalctl submit --from list.jsonl --wait
row e3 the results of a list as a table
try modalctl results --from list.jsonl --csv
row e4 e5 e7 files, keywords and a plot by one line from Python
try python3 -c 'import modald
with modald.local() as c:
    r = c.identify(modald.read("plain.csv"), options={"shapes": True})
    print(r.frequency_hz, r.shapes.shape, type(r.plot()).__name__, len(r._repr_html_()))
    print(next(c.map([modald.read("plain.csv")], shapes=True)).damping_ratio)'
for words in 'c.identify("plain.csv")' 'c.identify([1.0] * 100, 0.01, shapes=True)'; do
    try python3 -c "import modald
with modald.local() as c:
    try: $words
    except modald.Error as error: print(error)"
done
row e6 help has no empty docstring
try python3 -c 'import inspect, modald
print([name for name, member in inspect.getmembers(modald.Client, callable)
       if name[0] != "_" and not inspect.getdoc(member)])'
kill $first; wait $first; echo "[exit $?]"
