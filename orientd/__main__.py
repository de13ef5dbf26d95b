"""``python -m orientd`` is the command `orientd`."""

from orientd.cli.start import main

if __name__ == "__main__":
    main()
