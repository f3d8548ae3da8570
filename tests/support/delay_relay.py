#!/usr/bin/env python3
"""A long line for tests where the kernel has no netem: a relay that hands everything on later.

usage: delay_relay.py HOST PORT MILLISECONDS

Listens on a free port of 127.0.0.1, prints it and relays to HOST:PORT until its stdin ends. MILLISECONDS is the
time there and back: half of it passes for all bytes in each direction, however many are underway, and all of it
once more at the begin of a connection, for its handshake. Python's library alone.
"""
import asyncio
import os
import sys
import threading


async def pump(reader, writer, delay, first_delay=0.0):
    """Hands on in order, each piece `delay` after it came."""
    loop = asyncio.get_running_loop()
    queue = asyncio.Queue()

    async def send():
        while True:
            due, data = await queue.get()
            await asyncio.sleep(max(0.0, due - loop.time()))
            if not data:
                break
            writer.write(data)
            await writer.drain()
        if writer.can_write_eof():
            writer.write_eof()

    sender = asyncio.create_task(send())
    try:
        opened = loop.time() + first_delay
        while data := await reader.read(1 << 18):
            queue.put_nowait((max(loop.time(), opened) + delay, data))
    except ConnectionError:
        pass
    queue.put_nowait((loop.time() + delay, b""))
    try:
        await sender
    except ConnectionError:
        pass


async def main():
    host, port, delay = sys.argv[1], int(sys.argv[2]), float(sys.argv[3]) / 1000

    async def serve(reader, writer):
        far_reader, far_writer = await asyncio.open_connection(host, port)
        await asyncio.gather(pump(reader, far_writer, delay / 2, delay), pump(far_reader, writer, delay / 2))
        writer.close()
        far_writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0, backlog=256)
    print(server.sockets[0].getsockname()[1], flush=True)
    threading.Thread(target=lambda: (sys.stdin.read(), os._exit(0)), daemon=True).start()
    await server.serve_forever()


asyncio.run(main())
