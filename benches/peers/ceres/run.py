#!/usr/bin/env python3
"""Solves the same problems with cellmap and with Ceres, and prints a table.

    benches/peers/ceres/run.py [--rounds N] [SIZE ...]

Builds both (cargo; g++ with Debian's libceres-dev), writes each problem once, runs everybody in turn from the same start, and checks that all reach the same
cost (1e-8 relative) and the same poses (1e-9 m). Each figure is the median of its rounds. Ceres has two threads and the best of its linear solvers.
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
# The plain way needs more than this machine's patience on the largest cell; moving boards make thousands of unknowns, too many for a dense matrix.
SKIPPED = {("hall", "plain"), ("moving", "DENSE_NORMAL_CHOLESKY")}
LONGEST = 240


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
    arguments.add_argument("--lens", choices=["fixed", "free", "both"], default="both")
    arguments.add_argument("sizes", nargs="*", default=["small", "paper", "cell", "moving"])
    wanted = arguments.parse_args()
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    subprocess.run(["cargo", "build", "--release", "--quiet", "--example", "solver_peer"], cwd=ROOT, check=True)
    ours = target / "release/examples/solver_peer"
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        theirs = folder / "solve"
        subprocess.run(
            ["g++", "-std=c++17", "-O3", "-DNDEBUG", HERE / "solve.cpp", "-I/usr/include/eigen3", "-o", theirs, "-lceres", "-lglog"],
            check=True,
        )
        cpu = next((l.split(":")[1].strip() for l in open("/proc/cpuinfo") if l.startswith("model name")), "?")
        print(f"{cpu}, {os.cpu_count()} cores, {platform.system()} {platform.release()}, {time.strftime('%Y-%m-%d')}, "
              f"load {os.getloadavg()[0]:.1f}, medians of {wanted.rounds} rounds\n")
        print("| size | lenses | who | solve s | build s | iterations | times cellmap | peak MB | cost against cellmap's | poses apart m |")
        print("|---|---|---|---|---|---|---|---|---|---|")
        good = True
        for size in wanted.sizes:
            for lens in ["fixed", "free"] if wanted.lens == "both" else [wanted.lens]:
                good &= compare(size, lens, wanted.rounds, folder, ours, theirs)
    sys.exit(0 if good else 1)


def compare(size, lens, rounds, folder, ours, theirs):
    problem = folder / "problem"
    subprocess.run([ours, "write", size, lens, problem], check=True)
    runs = {("cellmap", ""): [ours, "solve", size, lens, folder / "cellmap"]}
    for way in ["careful", "plain"]:
        for solver in SOLVERS:
            if (size, way) not in SKIPPED and (size, solver) not in SKIPPED:
                runs[(way, solver)] = [theirs, problem, way, solver, folder / f"{way}_{solver}"]
    found = {key: [] for key in runs}
    for _ in range(rounds):
        for key, command in runs.items():
            if found[key] and "cost" not in found[key][-1]:
                continue
            found[key].append(run([str(part) for part in command]))
    good = True
    own = found[("cellmap", "")]
    base = statistics.median(r["seconds"] for r in own)
    for way in ["cellmap", "careful", "plain"]:
        usable = {k: r for k, r in found.items() if k[0] == way and all("cost" in one for one in r)}
        for key, results in found.items():
            if key[0] == way and key not in usable:
                print(f"| {size} | {lens} | {way} {key[1]} | {results[-1]['words']} | | | | | | |")
        if not usable:
            continue
        median = {k: statistics.median(r["seconds"] for r in results) for k, results in usable.items()}
        best = min(median, key=median.get)
        last = usable[best][-1]
        cost = abs(last["cost"] - own[-1]["cost"]) / own[-1]["cost"]
        apart = farthest(folder / "cellmap", runs[best][-1])
        good &= cost < 1e-8 and apart < 1e-9
        build = statistics.median(r.get("build_seconds", 0.0) for r in usable[best])
        peak = statistics.median(r["peak_mb"] for r in usable[best])
        print(f"| {size} | {lens} | {way} {best[1]} | {median[best]:.4f} | {build:.3f} | {last['iterations']} | {median[best] / base:.1f} | "
              f"{peak:.0f} | {cost:.1e} | {apart:.1e} |", flush=True)
    return good


main()
