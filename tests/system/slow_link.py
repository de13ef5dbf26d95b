"""A slow link: a TCP port that hands on to another what it hears, later."""

import asyncio
import contextlib
import random
import threading


class SlowLink:
    """Carries both ways with a delay that varies, in order, until the context ends."""

    def __init__(self, port, *, delay=0.020, jitter=0.005, seed=1):
        self._to, self._delay, self._jitter = port, delay, jitter
        self._chance = random.Random(seed)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._ready = threading.Event()
        self.port = 0

    def __enter__(self):
        self._thread.start()
        self._ready.wait()
        return self

    def __exit__(self, *_):
        self._loop.call_soon_threadsafe(self._ending.set)
        self._thread.join()

    def _run(self):
        self._loop.run_until_complete(self._serve())
        self._loop.close()

    async def _serve(self):
        self._ending = asyncio.Event()
        self._carrying, self._writers = set(), []
        server = await asyncio.start_server(self._meet, "127.0.0.1", 0)
        self.port = server.sockets[0].getsockname()[1]
        self._ready.set()
        await self._ending.wait()
        server.close()
        for one in self._carrying:
            one.cancel()
        await asyncio.gather(*self._carrying, return_exceptions=True)
        for writer in self._writers:
            writer.transport.abort()
        await asyncio.sleep(0)  # for the loop to let go of them
        await server.wait_closed()

    async def _meet(self, reader, writer):
        there, back = await asyncio.open_connection("127.0.0.1", self._to)
        self._writers += [back, writer]
        for source, into in ((reader, back), (there, writer)):
            queue = asyncio.Queue()
            for work in (self._take(source, queue), self._hand_on(queue, into)):
                task = asyncio.ensure_future(work)
                self._carrying.add(task)
                task.add_done_callback(self._carrying.discard)

    async def _take(self, source, queue):
        while True:
            with contextlib.suppress(OSError):
                chunk = await source.read(65536)
            delay = self._delay + self._chance.uniform(-self._jitter, self._jitter)
            await queue.put((self._loop.time() + delay, chunk))
            if not chunk:
                return

    async def _hand_on(self, queue, into):
        while True:
            due, chunk = await queue.get()
            await asyncio.sleep(max(0.0, due - self._loop.time()))
            if not chunk:
                into.close()
                return
            with contextlib.suppress(OSError):
                into.write(chunk)
