#!/usr/bin/env python3
"""A long line for tests where the kernel has no netem: a relay that hands everything on later.

usage: delay_relay.py HOST PORT MILLISECONDS [MEGABITS]

Listens on a free port of 127.0.0.1, prints it and relays to HOST:PORT until its stdin ends. MILLISECONDS is the
time there and back: half of it passes for all bytes in each direction, however many are underway, and all of it
once more at the begin of a connection, for its handshake. With MEGABITS so many a second pass in each direction, and
at most 50 ms of them wait at the begin of the line. Python's library alone.
"""
import asyncio
import os
import socket
import sys
import threading


PIECE = 4096  # bytes that pass a slow line at once
WAITING_SECONDS = 0.05


async def pump(reader, writer, delay, rate, first_delay=0.0):
    """Hands on in order, each piece `delay` after it came and the line was free for it."""
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
        free = loop.time() + first_delay
        while data := await reader.read(PIECE if rate else 1 << 18):
            free = max(loop.time(), free) + (len(data) / rate if rate else 0.0)
            queue.put_nowait((free + delay, data))
            if rate:
                await asyncio.sleep(max(0.0, free - loop.time() - WAITING_SECONDS))
    except ConnectionError:
        pass
    queue.put_nowait((loop.time() + delay, b""))
    try:
        await sender
    except ConnectionError:
        pass


async def main():
    host, port, delay = sys.argv[1], int(sys.argv[2]), float(sys.argv[3]) / 1000
    rate = 125_000 * float(sys.argv[4]) if len(sys.argv) > 4 else 0.0  # bytes a second

    async def serve(reader, writer):
        far = socket.socket()
        if rate:  # else megabytes wait in front of the line
            far.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8 * PIECE)
        far.setblocking(False)
        await asyncio.get_running_loop().sock_connect(far, (host, port))
        far_reader, far_writer = await asyncio.open_connection(sock=far, limit=PIECE if rate else 1 << 16)
        await asyncio.gather(pump(reader, far_writer, delay / 2, rate, delay),
                             pump(far_reader, writer, delay / 2, rate))
        writer.close()
        far_writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0, backlog=256)
    print(server.sockets[0].getsockname()[1], flush=True)
    threading.Thread(target=lambda: (sys.stdin.read(), os._exit(0)), daemon=True).start()
    await server.serve_forever()


asyncio.run(main())
