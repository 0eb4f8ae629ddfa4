#!/usr/bin/env python3
"""Solves the same problems with cellmap and with Ceres, and prints a table.

    benches/peers/ceres/run.py [--rounds N] [--long SECONDS] [--lens fixed|free] [--through COMMAND] [SIZE ...]

Builds both (cargo, as `make dist` does; g++ with Debian's libceres-dev), writes each problem once, runs everybody in turn from the same start, and checks that all reach the same
cost (1e-8 relative) and the same poses (1e-9 m). Where Ceres stopped too early for that, it runs once more to the last digit of the cost, and both distances are
told. Ceres has two threads and the best of its linear solvers: the first round tries all that suit the size, later
ones repeat the quickest. Each figure is the median of its rounds; what takes longer than --long is not repeated. On a machine with other work the
processor's time says more than the wall's. Memory is all that a process ever held, reading the problem from a file included; of it, what is not
pages of the program and of libraries is its own.

Sizes (see `benches/support/sizes.rs`): small, paper (ten shots at each stop), single (one shot at each stop, so that cellmap cannot fold any), cell, moving, hall.
"""
import argparse
import array
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent.parent
SOLVERS = ["DENSE_SCHUR", "SPARSE_NORMAL_CHOLESKY", "DENSE_NORMAL_CHOLESKY"]
LONGEST = 600
# How near poses must be, m.
CLOSE = 1e-9
# A function tolerance that only a cost without another digit meets.
TO_THE_LAST = "1e-17"


def suits(size, way, solver):
    """Whether there is room and patience: a dense Jacobian of the larger sizes does not fit this kind of machine, nor the plain way's doubles in the hall."""
    if solver == "DENSE_NORMAL_CHOLESKY" and size != "small" and (way == "plain" or size in ["cell", "moving", "hall"]):
        return False
    return (size, way) != ("hall", "plain")


def run(command):
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST)
    except subprocess.TimeoutExpired:
        return {"words": f"no end within {LONGEST} s"}
    if not done.stdout.strip():
        return {"words": done.stderr.strip().splitlines()[-1:] or f"ended with {done.returncode}"}
    return json.loads(done.stdout.strip().splitlines()[-1])


def poses(file):
    values = array.array("d")
    values.frombytes(Path(file).read_bytes())
    return values


def farthest(a, b):
    """The largest distance between the origins of corresponding poses, m."""
    a, b = poses(a), poses(b)
    if len(a) != len(b):
        raise SystemExit("the programs wrote different numbers of poses")
    return max(max(abs(a[i + k] - b[i + k]) for k in (4, 5, 6)) for i in range(0, len(a), 7))


def main():
    arguments = argparse.ArgumentParser()
    arguments.add_argument("--rounds", type=int, default=3)
    arguments.add_argument("--long", type=float, default=20.0, help="runs that take more seconds than this are not repeated")
    arguments.add_argument("--through", default="", help="a command put before each run, such as `taskset -c 0,1`")
    arguments.add_argument("--cellmap", help="the example `solver_peer`, built before, with `solver_problem` beside it")
    arguments.add_argument("--lens", choices=["fixed", "free", "both"], default="both")
    arguments.add_argument("sizes", nargs="*", default=["small", "paper", "single", "cell", "moving"])
    wanted = arguments.parse_args()
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    if not wanted.cellmap:
        # As `make dist` builds what is given to others.
        for example in ["solver_problem", "solver_peer"]:
            subprocess.run(["cargo", "rustc", "--profile", "dist", "--quiet", "--example", example, "--", "-C", "target-feature=+crt-static"], cwd=ROOT, check=True)
    ours = Path(wanted.cellmap or target / "dist/examples/solver_peer")
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        theirs = folder / "solve"
        subprocess.run(
            ["g++", "-std=c++17", "-O3", "-DNDEBUG", HERE / "solve.cpp", "-I/usr/include/eigen3", "-o", theirs, "-lceres", "-lglog"],
            check=True,
        )
        cpu = next((l.split(":")[1].strip() for l in open("/proc/cpuinfo") if l.startswith("model name")), "?")
        print(f"{cpu}, {os.cpu_count()} cores, {platform.system()} {platform.release()}, {time.strftime('%Y-%m-%d')}, "
              f"load {os.getloadavg()[0]:.1f}\n")
        print("| size | lenses | who | rounds | solve s | processor s | build s | iterations | times cellmap: wall | processor | peak MB, of it own | cost against cellmap's | poses apart m |")
        print("|---|---|---|---|---|---|---|---|---|---|---|---|---|")
        good = True
        for size in wanted.sizes:
            for lens in ["fixed", "free"] if wanted.lens == "both" else [wanted.lens]:
                good &= compare(size, lens, wanted, folder, ours, theirs)
    sys.exit(0 if good else 1)


def compare(size, lens, wanted, folder, ours, theirs):
    problem = folder / "problem"
    subprocess.run([ours.with_name("solver_problem"), size, lens, problem], check=True)
    runs = {("cellmap", ""): [ours, folder / "problem.cellmap", folder / "cellmap"]}
    for way in ["careful", "plain"]:
        for solver in SOLVERS:
            if suits(size, way, solver):
                runs[(way, solver)] = [theirs, problem, way, solver, folder / f"{way}_{solver}"]
    found = {key: [] for key in runs}
    best = {}
    for number in range(wanted.rounds):
        for key, command in runs.items():
            first = found[key][0] if found[key] else None
            if number > 0 and (key != best.get(key[0]) or first["seconds"] > wanted.long):
                continue
            found[key].append(run(wanted.through.split() + [str(part) for part in command]))
        for way in ["cellmap", "careful", "plain"] if number == 0 else []:
            usable = [key for key in runs if key[0] == way and "cost" in found[key][0]]
            if usable:
                best[way] = min(usable, key=lambda key: found[key][0]["seconds"])
    for key, results in found.items():
        if "cost" not in results[0]:
            print(f"| {size} | {lens} | {key[0]} {key[1]} | 1 | {results[0]['words']} | | | | | | | | |")
    good = True
    own = found[("cellmap", "")]
    base, processor_base = (statistics.median(r[what] for r in own) for what in ["seconds", "processor_seconds"])
    for key in best.values():
        results = found[key]
        cost = max(abs(one["cost"] - own[-1]["cost"]) / own[-1]["cost"] for one in results)
        apart = farthest(folder / "cellmap", runs[key][-1])
        told = f"{apart:.1e}"
        if apart >= CLOSE and key[0] != "cellmap":
            run([str(part) for part in runs[key]] + [TO_THE_LAST])
            apart = farthest(folder / "cellmap", runs[key][-1])
            told = f"{apart:.1e} ({told})"
        good &= cost < 1e-8 and apart < CLOSE
        what = ["seconds", "processor_seconds", "build_seconds", "peak_mb", "own_mb"]
        seconds, processor, build, peak, memory = (statistics.median(r.get(one, 0.0) for r in results) for one in what)
        print(f"| {size} | {lens} | {' '.join(key).strip()} | {len(results)} | {seconds:.4f} | {processor:.4f} | {build:.3f} | {results[-1]['iterations']} | "
              f"{seconds / base:.1f} | {processor / processor_base:.1f} | {peak:.1f}, {memory:.1f} | {cost:.1e} | {told} |", flush=True)
    return good


main()
