# fish completion for modalctl(1); verbs and options are asked of modalctl itself, so that they cannot differ from it
function __modalctl_words --description 'What may stand next; status 1 where that is a file'
    set -l words (commandline -opc)
    set -l word (commandline -ct)
    set -l before $words[-1]
    set -l verbs (modalctl --help 2>/dev/null | string match -rg '^  ([a-z]+) ')
    set -l verb
    for one in $words[2..-1]
        contains -- $one $verbs; and set verb $one; and break
    end
    switch $before
        case --state
            printf '%s\n' queued running done failed cancelled dead
            return 0
        case --keyfile -O --output --plot --prometheus --from --data --sbatch
            return 1
        case -o --option
            modalctl $verb --help 2>/dev/null | string match -rg '^  ([a-z._]+=)'
            return 0
    end
    if string match -q -- '-*' $word
        modalctl $verb --help 2>/dev/null | string match -rga '(?:^| )(--?[a-z-]+)'
    else if test -z "$verb"
        printf '%s\n' $verbs
    else if test $verb = submit -a $before = submit
        printf '%s\n' identify steady simulate floquet tradeoff ablate sweep
    else if test $verb = tradeoff -a $before = tradeoff
        printf '%s\n' identify steady simulate
    else
        return 1
    end
    return 0
end
complete -c modalctl -n '__modalctl_words >/dev/null' -f -a '(__modalctl_words)'
