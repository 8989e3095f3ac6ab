#compdef modalctl
# zsh completion for modalctl(1); verbs and options are asked of modalctl itself, so that they cannot differ from it
_modalctl()
{
    local word=$words[CURRENT] before=$words[CURRENT-1] verb= i
    local -a verbs
    verbs=(${(f)"$(modalctl --help 2>/dev/null | sed -n 's/^  \([a-z]\{1,\}\) .*/\1/p')"})
    for ((i = 2; i < CURRENT; i++)); do
        (( ${verbs[(Ie)$words[i]]} )) && { verb=$words[i]; break }
    done
    case $before in
        --state) compadd -- queued running done failed cancelled dead; return ;;
        --keyfile|-O|--output|--plot|--prometheus|--from|--data|--sbatch) _files; return ;;
        -o|--option) compadd -S '' -- $(modalctl $verb --help 2>/dev/null | sed -n 's/^  \([a-z._]\{1,\}=\).*/\1/p'); return ;;
    esac
    if [[ $word == -* ]]; then
        compadd -- $(modalctl $verb --help 2>/dev/null | grep -oE -- '(^| )--?[a-z-]+' | tr -d ' ')
    elif [[ -z $verb ]]; then
        compadd -- $verbs
    elif [[ $verb == submit && $before == submit ]]; then
        compadd -- identify steady simulate floquet tradeoff ablate sweep
    elif [[ $verb == tradeoff && $before == tradeoff ]]; then
        compadd -- identify steady simulate
    else
        _files
    fi
}
_modalctl "$@"
