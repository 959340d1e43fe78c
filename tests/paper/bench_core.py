"""Trajectory-steps a second of the study's core against C, in one run, both reading the same noise from the same file.

    python -m tests.paper.bench_core

C is tests/bench_c/paper_core.c, gcc -O3 -march=native. One core: rounds of C and of ours, turn by turn, and the median
of the rounds' ratios. Two workers: two C processes against two threads of ours, each over one process or thread alone.
"""

from __future__ import annotations

import math
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from circumnav_mav.study import paper_core as core
from circumnav_mav.study import paper_run as run
from circumnav_mav.study.noise import normals

SOURCE = Path(__file__).parents[1] / "bench_c" / "paper_core.c"
RUNS, STEPS, K, SECONDS, ROUNDS = 512, 700, 1.0, 0.6, 7


def build_c(folder: Path) -> Path | None:
    """Return the program built from its source, or None without a C compiler."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        return None
    program = folder / "paper_core"
    subprocess.run([compiler, "-O3", "-march=native", str(SOURCE), "-o", str(program), "-lm"], check=True)
    return program


def start_c(program: Path, noise: Path, runs: int, steps: int, k: float, seconds: float) -> subprocess.Popen[str]:
    command = [str(program), str(noise), str(runs), str(steps), repr(k), str(seconds)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def read_c(process: subprocess.Popen[str]) -> list[float]:
    """Return rate and the four means that the program printed."""
    out, _ = process.communicate()
    if process.returncode:
        raise RuntimeError(f"the C program failed with exit code {process.returncode}")
    return [float(word) for word in out.split()]


def ours(noise: core.Floats, seconds: float) -> float:
    """Return the rate [steps/s] of the median pass in `seconds`, on the calling thread."""
    one = run.case("hashemi2013", {"k": K}, run.Plant())
    start = np.repeat(np.array([[-20.0], [0.0], [1.0], [0.0]]), len(noise), axis=1)
    took, end_s = [], time.perf_counter() + seconds
    while not took or time.perf_counter() < end_s:
        begun_s = time.perf_counter()
        run.fly_in(one, start, noise)
        took.append(time.perf_counter() - begun_s)
    return noise.size / statistics.median(took)


def compare(seconds: float = SECONDS, rounds: int = ROUNDS) -> dict[str, float] | None:
    """Return the measured rates and ratios, or None without a C compiler."""
    with tempfile.TemporaryDirectory() as name, ThreadPoolExecutor(2) as pool:
        program = build_c(Path(name))
        if program is None:
            return None
        noise, file = 0.5 * normals(1, 0, 0, RUNS, STEPS), Path(name) / "noise.bin"
        noise.tofile(file)
        ours(noise, 0.0)  # compiles
        table: dict[str, list[float]] = {"c": [], "ours": [], "c_two": [], "ours_two": []}
        for _ in range(rounds):
            table["c"].append(read_c(start_c(program, file, RUNS, STEPS, K, seconds))[0])
            table["ours"].append(ours(noise, seconds))
            pair = [start_c(program, file, RUNS, STEPS, K, seconds) for _ in range(2)]
            table["c_two"].append(sum(read_c(one)[0] for one in pair))
            table["ours_two"].append(sum(pool.map(lambda _: ours(noise, seconds), range(2))))
    median = {name: statistics.median(values) for name, values in table.items()}
    ratio = statistics.median(o / c for o, c in zip(table["ours"], table["c"], strict=True))
    gain_c = statistics.median(two / one for two, one in zip(table["c_two"], table["c"], strict=True))
    gain_ours = statistics.median(two / one for two, one in zip(table["ours_two"], table["ours"], strict=True))
    return {**median, "one_core": ratio, "c_gain": gain_c, "our_gain": gain_ours, "two_workers": gain_ours / gain_c}


def main() -> int:
    found = compare()
    if found is None:
        print("skipped: no C compiler (gcc or cc) on this machine to compare with")
        return 0
    print(f"C        {found['c'] / 1e6:7.1f} M steps/s, two processes {found['c_two'] / 1e6:7.1f} M")
    print(f"the core {found['ours'] / 1e6:7.1f} M steps/s, two workers   {found['ours_two'] / 1e6:7.1f} M")
    ok = found["one_core"] >= 1.0 and found["two_workers"] >= 0.85
    print(f"one core against scalar C: {found['one_core']:.2f} (at least 1.0)")
    print(f"two workers against what two C processes gain: {found['two_workers']:.2f} (at least 0.85)")
    return 0 if ok and all(math.isfinite(value) for value in found.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
