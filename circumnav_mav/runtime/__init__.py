"""ASYNCIO: sockets, the clock, files. The only ring that touches the world."""
