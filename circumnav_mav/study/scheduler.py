"""The same sweep beyond one machine: a Dask scheduler through its executor interface (extra: circumnav-mav[cluster]).

Every worker needs this package in the same version. The numbers are those of one machine, bit for bit on the same kind
of processor: a task is (case, seed, first run, count), and its noise depends on these alone.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

CONNECT_S = 10.0
ADDRESS = re.compile(r"tcp://(?:\[[0-9A-Fa-f:.]+\]|[^\s:/\[\]]+):([0-9]{1,5})")


@contextmanager
def executor(address: str | None) -> Iterator[Executor | None]:
    """Yield an executor on the scheduler at `address` (tcp://HOST:PORT), or None for None: this machine's own threads.

    Raises ValueError in words when the address is none, the extra is missing or nobody answers.
    """
    if address is None:
        yield None
        return
    form = ADDRESS.fullmatch(address)
    if form is None or not 0 < int(form[1]) < 2**16:
        # Before there is a client: one that was made for nonsense waits long, and complains again as it is collected.
        raise ValueError(f"--scheduler wants an address such as tcp://10.0.0.1:8786, not '{address}'")
    try:
        from distributed import Client
    except ImportError:
        raise ValueError("a scheduler needs the extra: pip install 'circumnav-mav[cluster]'") from None
    try:
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ValueError(f"no scheduler answers at {address} (start one with `dask scheduler`): {error}") from None
    try:
        yield client.get_executor(pure=False)
    finally:
        client.close()
