#compdef orientd

_orientd_completion() {
  eval $(env _TYPER_COMPLETE_ARGS="${words[1,$CURRENT]}" _ORIENTD_COMPLETE=complete_zsh orientd)
}

# Read as a function of its name on the first Tab, or sourced.
if [ "$funcstack[1]" = "_orientd" ]; then
  _orientd_completion "$@"
else
  compdef _orientd_completion orientd
fi
