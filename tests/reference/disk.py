"""A disk as it is after a loss of power."""

import os
import threading
from pathlib import Path


class Disk:
    """A disk that forgets, when the power is cut, every content and name that was not synced."""

    def __init__(self, monkeypatch, folder):
        self._sync, self._contents, self._names = os.fsync, {}, {}
        self._lock, self._folder = threading.Lock(), folder
        self.seen = []
        monkeypatch.setattr(os, "fsync", self._synced)
        for name in ("replace", "rename"):
            monkeypatch.setattr(os, name, self._then_look(getattr(os, name)))
        self.keep_all()

    def keep_all(self):
        """Have everything on the disk as it is now."""
        for path in self._folder.iterdir():
            self._contents[path.stat().st_ino] = path.read_bytes()
        self._names = {path.name: path.stat().st_ino for path in self._folder.iterdir()}

    def after_power_cut(self):
        """Return the contents of the files that are left, by their names."""
        with self._lock:
            return {name: self._contents.get(at, b"") for name, at in self._names.items()}

    def _synced(self, descriptor):
        self._sync(descriptor)
        path = Path(f"/proc/self/fd/{descriptor}")
        with self._lock:
            if path.samefile(self._folder):
                self._names = {one.name: one.stat().st_ino for one in self._folder.iterdir()}
            elif path.is_file():
                self._contents[os.fstat(descriptor).st_ino] = path.read_bytes()
        self.seen.append(self.after_power_cut())

    def _then_look(self, change):
        def changed(*names, **more):
            change(*names, **more)
            self.seen.append(self.after_power_cut())

        return changed
