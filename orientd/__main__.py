"""``python -m orientd`` is the command `orientd`."""

from orientd.cli.start import main

if __name__ == "__main__":
    try:
        main()
    finally:
        # An interrupt within code of a string, such as a dataclass being made, has CPython end by
        # that signal, even if it was handled.  The next code of a string clears that.
        exec("")
