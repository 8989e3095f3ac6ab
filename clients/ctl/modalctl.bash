# bash completion for modalctl(1); verbs and options are asked of modalctl itself, so that they cannot differ from it
_modalctl()
{
    local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD-1]} verb= i
    local verbs
    verbs=$(modalctl --help 2>/dev/null | sed -n 's/^  \([a-z]\+\) .*/\1/p')
    for ((i = 1; i < COMP_CWORD; i++)); do
        [[ " ${verbs//$'\n'/ } " == *" ${COMP_WORDS[i]} "* ]] && { verb=${COMP_WORDS[i]}; break; }
    done
    case $before in
        --state) COMPREPLY=($(compgen -W "queued running done failed cancelled dead" -- "$word")); return ;;
        --keyfile|-O|--output|--plot|--prometheus|--from|--data|--sbatch) COMPREPLY=($(compgen -f -- "$word")); return ;;
        -o|--option) COMPREPLY=($(compgen -W "$(modalctl $verb --help 2>/dev/null | sed -n 's/^  \([a-z._]\+=\).*/\1/p')" -- "$word"))
            compopt -o nospace; return ;;
    esac
    if [[ $word == -* ]]; then
        COMPREPLY=($(compgen -W "$(modalctl $verb --help 2>/dev/null | grep -oE -- '(^| )--?[a-z-]+' | tr -d ' ')" -- "$word"))
    elif [[ -z $verb ]]; then
        COMPREPLY=($(compgen -W "$verbs" -- "$word"))
    elif [[ $verb == submit && $before == submit ]]; then
        COMPREPLY=($(compgen -W "identify steady simulate floquet tradeoff ablate sweep" -- "$word"))
    elif [[ $verb == tradeoff && $before == tradeoff ]]; then
        COMPREPLY=($(compgen -W "identify steady simulate" -- "$word"))
    else
        COMPREPLY=($(compgen -f -- "$word"))
    fi
}
complete -o filenames -F _modalctl modalctl
