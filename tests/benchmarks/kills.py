"""What kill -9 leaves behind: broken files, mixed pairs that nobody is told of, litter after the next run.

    python -m tests.benchmarks.kills [AT RANDOM] [AT STEPS]

Two calibrations of one robot, from measurements of different seeds, take turns at one place. A run is killed at a random time, or just
before or after one of the steps that touch the disk (opened, written, linked, renamed). Then both files of the pair are looked at: each
is, byte for byte but for the record's time, one of the two results or nothing; where they are not of one run, `apply` says so; and after
the next run that is left alone nothing is in the folder but the pair.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from tests.support.small_robot import URDF

STEPS = ("open", "fsync", "link", "replace", "rename")
HOOK = """
import os, signal, sys
left = int(sys.argv.pop(1))
def dying(call):
    def step(*given, **how):
        global left
        if "urdfcal-" not in str(given) and call.__name__ == "open" and not (len(given) > 1 and given[1] & os.O_WRONLY):
            return call(*given, **how)
        left -= 1
        if left == 0: os.kill(os.getpid(), signal.SIGKILL)
        done = call(*given, **how)
        left -= 1
        if left == 0: os.kill(os.getpid(), signal.SIGKILL)
        return done
    return step
for name in {steps}: setattr(os, name, dying(getattr(os, name)))
from urdfcal.cli.main import main
main()
"""
PAIR = ("small_calibrated.urdf", "small_calibration.yaml")
FIT = ("--no-sag", "--prior", "stated", "--no-sanity", "--overwrite", "-q")


def command(*words: str) -> list[str]:
    return [sys.executable, "-m", "urdfcal.cli", *words]


def run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command(*words), cwd=folder, capture_output=True, text=True, check=False)


def contents(folder: Path) -> dict[str, bytes]:
    """The pair, without when it was made and what the command was."""
    found = {name: (folder / name).read_bytes() for name in PAIR if (folder / name).exists()}
    return {name: re.sub(rb"(?m)^(created|command): .*(\n  .*)*\n", b"", text) for name, text in found.items()}


class Study:
    """A folder in which calibrations are killed."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.seen = folder, Counter[str]()
        (folder / "small.urdf").write_text(URDF)
        self.results = {}
        for seed, name in enumerate("ab", start=1):
            run(folder, "simulate", "small.urdf", "-o", f"{name}.csv", "--poses", "15", "--seed", str(seed), "--errors", "5mm,0.5deg")
            started = time.perf_counter()
            run(folder, *self.fit(name))
            self.takes = time.perf_counter() - started
            self.results[name] = contents(folder)
        self.inputs = {path.name for path in folder.iterdir()} - {*PAIR}

    def fit(self, name: str) -> tuple[str, ...]:
        return ("fit", "small.urdf", f"{name}.csv", *FIT)

    def kill(self, at_random: int, at_steps: int) -> None:
        """Kill so often at random times and at steps, with runs that are left alone between."""
        rng, turns = random.Random(0), itertools.cycle("ab")
        for number in range(at_random):
            self.kill_at_random(next(turns), rng)
            if number % 10 == 9:
                self.next_run(next(turns))
        for number in range(at_steps):
            self.kill_at_step(next(turns), 1 + number % 16)
            if number % 5 == 4:
                self.next_run(next(turns))
        self.next_run(next(turns))

    def kill_at_random(self, name: str, rng: random.Random) -> None:
        """Kill at some time, more often near the end, where files are written."""
        running = subprocess.Popen(command(*self.fit(name)), cwd=self.folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(self.takes * (rng.uniform(0.0, 1.0) if rng.random() < 0.3 else rng.uniform(0.75, 1.0)))
        running.send_signal(signal.SIGKILL)
        self.look("killed at random" if running.wait() == -signal.SIGKILL else "done before the kill at random")

    def kill_at_step(self, name: str, step: int) -> None:
        """Kill before or after a step."""
        words = [sys.executable, "-c", HOOK.format(steps=STEPS), str(step), *self.fit(name)]
        done = subprocess.run(words, cwd=self.folder, capture_output=True, check=False)
        self.look("killed at a step" if done.returncode == -signal.SIGKILL else "done before the step")

    def look(self, how: str) -> None:
        """Count what is there."""
        self.seen[how] += 1
        found = contents(self.folder)
        whose = {name: [run for run, result in self.results.items() if result[name] == text] for name, text in found.items()}
        self.seen["broken files"] += sum(not runs for runs in whose.values())
        if len(whose) == len(PAIR) and all(whose.values()) and whose[PAIR[0]] != whose[PAIR[1]]:
            said = run(self.folder, "apply", "small.urdf", PAIR[1], "-o", "-").stderr
            self.seen["mixed pairs told of" if "are a mixed pair" in said else "mixed pairs UNDETECTED"] += 1
        self.seen["left parts"] += len(self.litter())

    def litter(self) -> set[str]:
        return {path.name for path in self.folder.iterdir()} - self.inputs - {*PAIR}

    def next_run(self, name: str) -> None:
        """A run that is left alone."""
        self.seen["next runs that failed"] += run(self.folder, *self.fit(name)).returncode != 0
        self.seen["litter after the next run"] += len(self.litter())


def main(at_random: int = 40, at_steps: int = 40) -> None:
    """Print what was left."""
    with tempfile.TemporaryDirectory() as place:
        study = Study(Path(place))
        with contextlib.suppress(KeyboardInterrupt):  # Ctrl-C: what was seen so far
            study.kill(at_random, at_steps)
    for what in sorted({*study.seen, "mixed pairs UNDETECTED"}):
        print(f"{study.seen[what]:5d}  {what}")


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main(*map(int, sys.argv[1:]))
