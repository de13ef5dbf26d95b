"""Commands in virtual time: ``python -m orientd`` runs as the tasks of a process of the world.

A command has its own standard streams, arguments, environment, directory and signals.  They are in
the place of the test's while one of its tasks runs.
"""

from __future__ import annotations

import _thread
import asyncio
import concurrent.futures.thread  # noqa: F401 - the locks of a module that a world loads are its
import contextlib
import functools
import logging
import os
import signal
import subprocess
import sys
import threading
import weakref
from pathlib import Path
from types import SimpleNamespace

import click
from processes import Process
from virtual_pipes import Pipe, reader, writer
from virtual_time import VirtualLoop

from orientd.cli import interrupts, start
from orientd.cli.commands import track
from orientd.daemon import log, server
from orientd.daemon.access import claim
from orientd.stream.memory import SharedMemory

COMMAND = [sys.executable, "-m", "orientd"]

_SHARED = [
    (sys, "stdin"),
    (sys, "stdout"),
    (sys, "stderr"),
    (sys, "argv"),
    (sys, "warnoptions"),
    (os, "environ"),
    (click.globals, "_local"),
    (logging.root, "handlers"),
]
"""What each process has for itself."""

_REAL = {name: getattr(os, name) for name in ("read", "write", "chdir", "getcwd")}
_OPEN, _WRITER, _LOCK, _POPEN = open, log.writer, claim._lock, subprocess.Popen
_FINALIZE, _MAP = weakref.finalize, SharedMemory.__init__


class Own:
    """What a process has for itself.

    Attributes:
        ends: of the pipes to its standard streams, by name, for whoever has started it.
    """

    def __init__(self, world, process, args, options):
        self._world, self._process, self.ends = world, process, {}
        is_text = bool(options.get("text") or options.get("encoding"))
        streams = {}
        for name in ("stdin", "stdout", "stderr"):
            given = options.get(name)
            if given == subprocess.STDOUT:
                streams[name] = streams["stdout"]
            elif given == subprocess.PIPE:
                streams[name] = self._piped(name, is_text)
            else:
                streams[name] = self._opened(given, "r" if name == "stdin" else "w")
        environment = options.get("env")
        self._values = [
            *streams.values(),
            ["orientd", *args],
            ["default"],
            dict(os.environ if environment is None else environment),
            threading.local(),
            [],
        ]
        self._directory = str(options.get("cwd") or Path.cwd())

    def _piped(self, name, is_text):
        """Return the process' end of a pipe."""
        pipe, parent = Pipe(self._world.scheduler), self._world.present()
        self._world.pipes[pipe.number] = pipe
        ours, theirs = (writer, reader) if name == "stdin" else (reader, writer)
        own, self.ends[name] = theirs(pipe, is_text=True), ours(pipe, is_text=is_text)
        self._process.at_end(own.close)
        if parent is not None:
            parent.at_end(self.ends[name].close)
        return own

    def _opened(self, given, mode):
        """Return a stream of a real file; nothing is read from a test's own input."""
        if given is None or given == subprocess.DEVNULL:
            stream = _OPEN(os.devnull, mode)
        else:
            stream = _OPEN(os.dup(given if isinstance(given, int) else given.fileno()), mode)
        self._process.at_end(stream.close)
        return stream

    def exchange(self):
        """Exchange it for what is in its place."""
        for place, (owner, name) in enumerate(_SHARED):
            present = getattr(owner, name)
            setattr(owner, name, self._values[place])
            self._values[place] = present
        with contextlib.suppress(FileNotFoundError):  # its directory may be gone by now
            present = _REAL["getcwd"]()
            if present != self._directory:
                _REAL["chdir"](self._directory)
                self._directory = present


class Program(Process):
    """A command that runs, as :class:`subprocess.Popen` has it."""

    def __init__(self, world, args, **options):
        super().__init__(world.scheduler, "command")
        self.args = args
        self._signals = {signal.SIGINT: signal.default_int_handler}
        own = Own(world, self, map(str, args[len(COMMAND) :]), options)
        self.stdin, self.stdout, self.stderr = map(own.ends.get, ("stdin", "stdout", "stderr"))
        world.add(self)
        world.scheduler.own[self.group] = own.exchange
        self._main = world.scheduler.spawn(self._run, self.group, self.group)

    def _run(self):
        status = 1
        try:
            start.main()
        except SystemExit as error:
            status = error.code if isinstance(error.code, int) else int(error.code is not None)
        except KeyboardInterrupt:
            status = -signal.SIGINT
        finally:
            for handler in list(logging.root.handlers):
                handler.close()  # as the interpreter does at its end
            for stream in (sys.stdout, sys.stderr):
                if not stream.closed:
                    stream.flush()
            self.end(status)

    def _receive(self, number):
        if self.handler(number) == signal.SIG_DFL or number == signal.SIGKILL:
            self.end(-number)
        else:
            self._scheduler.interrupt(self._main, functools.partial(self._handle, number))

    def _handle(self, number):
        handler = self.handler(number)
        if handler not in (signal.SIG_DFL, signal.SIG_IGN):
            handler(number, None)

    # What tests call

    def communicate(self, content=None, timeout=None, **_):
        if self.stdin is not None and not self.stdin.closed:
            if content:
                self.stdin.write(content)
            self.stdin.close()
        self.wait(timeout)
        return tuple(
            None if stream is None or stream.closed else stream.read()
            for stream in (self.stdout, self.stderr)
        )

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for stream in (self.stdout, self.stderr, self.stdin):
            if stream is not None:
                stream.close()
        self.wait()

    # What its code calls

    def handler(self, number):
        return self._signals.get(number, signal.SIG_DFL)

    def handle(self, number, handler):
        before = self.handler(number)
        self._signals[number] = handler
        return before

    def descriptor(self, number):
        """Return the stream of a descriptor, if it is one of the standard ones."""
        names = ("stdin", "stdout", "stderr")
        return getattr(sys, names[number]) if 0 <= number < len(names) else None


def of_programs(world):
    """Return what commands find in a world: owners, names and values to replace."""

    def popen(args, *more, **options):
        words = [] if isinstance(args, str) else [os.fspath(one) for one in args]
        if words[: len(COMMAND)] == COMMAND:
            return Program(world, words, **options)
        return _POPEN(args, *more, **options)

    def getsignal(number):
        present = world.present()
        return present.handler(number) if isinstance(present, Program) else signal.SIG_DFL

    def handle(number, handler):
        present = world.present()
        return present.handle(number, handler) if isinstance(present, Program) else None

    def interrupt_main(number=signal.SIGINT):
        world.present().send_signal(number)

    def begin_thread(work, given):
        world.scheduler.spawn(functools.partial(work, *given), "thread")

    def new_loop():
        loop, present = VirtualLoop(world.scheduler), world.present()
        if present is not None:
            present.at_end(loop.abandon)
        return loop

    def leave(status):
        raise SystemExit(status)

    def read(descriptor, most):
        pipe = world.pipes.get(descriptor)
        return _REAL["read"](descriptor, most) if pipe is None else pipe.read(most)

    def write(descriptor, content):
        present = world.present()
        stream = present.descriptor(descriptor) if isinstance(present, Program) else None
        if stream is None:
            return _REAL["write"](descriptor, content)
        stream.write(bytes(content).decode())
        stream.flush()
        return len(content)

    def opened(file, *mode, **options):
        pipe = world.pipes.get(file) if isinstance(file, int) else None
        return _OPEN(file, *mode, **options) if pipe is None else reader(pipe, is_text=False)

    def lock(path, socket):
        descriptor = _LOCK(path, socket)
        inode = os.fstat(descriptor).st_ino

        def unlock():
            """Close it if the process was killed before it did."""
            with contextlib.suppress(OSError):
                if os.fstat(descriptor).st_ino == inode:
                    os.close(descriptor)

        world.present().at_end(unlock)
        return descriptor

    def finalized(held, work, *given, **options):
        """Close a descriptor that goes with its holder, which a killed process never lets go."""
        finalizer, present = _FINALIZE(held, work, *given, **options), world.present()
        if work is os.close and present is not None:
            present.at_end(finalizer)
        return finalizer

    def mapped(memory, *given, **options):
        _MAP(memory, *given, **options)
        if (present := world.present()) is not None:
            present.at_end(memory.close)

    def pipe():
        ends = os.pipe()
        if (present := world.present()) is not None:
            present.at_end(lambda: [os.close(end) for end in ends])
        return ends

    def log_writer(descriptor):
        pipe = world.pipes.get(descriptor)
        if pipe is None:
            return _WRITER(descriptor)
        handler = logging.StreamHandler(writer(pipe, is_text=True))
        handler.lock = None
        return handler

    return [
        (subprocess, "Popen", popen),
        (signal, "getsignal", getsignal),
        (signal, "signal", handle),
        (signal, "set_wakeup_fd", lambda *_, **__: -1),
        (start, "signal", signal),
        (interrupts, "_wake", lambda *_: None),
        (interrupts, "os", SimpleNamespace(pipe=pipe, set_blocking=os.set_blocking)),
        (weakref, "finalize", finalized),
        (SharedMemory, "__init__", mapped),
        (_thread, "interrupt_main", interrupt_main),
        (_thread, "start_new_thread", begin_thread),
        (asyncio.events, "new_event_loop", new_loop),
        (os, "_exit", leave),
        (os, "read", read),
        (os, "write", write),
        (os, "getpid", world.pid),
        (os, "getppid", world.parent_pid),
        (os, "setpriority", lambda *_: None),
        (track, "open", opened),
        (log, "writer", log_writer),
        (claim, "_lock", lock),
        (server, "_share_arenas", lambda: None),
        (server.gc, "freeze", lambda: None),
        (server.gc, "collect", lambda *_: 0),
    ]
