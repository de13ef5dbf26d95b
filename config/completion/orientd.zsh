#compdef orientd

_orientd_completion() {
  eval $(env _TYPER_COMPLETE_ARGS="${words[1,$CURRENT]}" _ORIENTD_COMPLETE=complete_zsh orientd)
}

compdef _orientd_completion orientd
