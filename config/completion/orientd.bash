_orientd_completion() {
    local IFS=$'
'
    COMPREPLY=( $( env COMP_WORDS="${COMP_WORDS[*]}" \
                   COMP_CWORD=$COMP_CWORD \
                   _ORIENTD_COMPLETE=complete_bash $1 ) )
    return 0
}

complete -o default -F _orientd_completion orientd
