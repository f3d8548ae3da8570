#!/usr/bin/env python3
"""Prints the table of tools/guard/measure_jobs.py, and says which jobs are worse than before.

    compare_jobs.py TABLE.json

Ends with 1 if a job is worse than a threshold or failed, with 2 if the table cannot be read."""
import json
import sys
from statistics import median

# A figure is worse if it is greater by this factor, and by this much: what is small is mostly noise.
TIME = (1.10, 0.002)
MEMORY = (1.10, 4 << 20)
BYTES = (1.02, 64 << 10)
INSTRUCTIONS = (1.03, 1_000_000)
# The share of rounds in which the job took longer than the other commit's in the same round.
SHARE_OF_ROUNDS = 2 / 3
# The least times must differ too, by this: others on the machine make times longer, never shorter.
LEAST_TIME = 1.05


def is_worse(base, head, threshold):
    factor, difference = threshold
    return head > base * factor and head > base + difference


def time_is_worse(base, head):
    """Paired by rounds. Only a change that most rounds and the least times show is taken for one."""
    longer = sum(h > b for b, h in zip(base, head))
    ratio = median(h / b for b, h in zip(base, head))
    return (ratio > TIME[0] and median(head) > median(base) + TIME[1] and longer >= SHARE_OF_ROUNDS * len(base)
            and min(head) > LEAST_TIME * min(base))


def worse_figures(job):
    """Names of the measures in which a job became worse."""
    if "failure" in job:
        return ["failed"]
    found = []
    if time_is_worse(job["seconds"]["base"], job["seconds"]["head"]):
        found.append("time")
    if is_worse(*(median(job["peak_bytes"][side]) for side in ("base", "head")), MEMORY):
        found.append("memory")
    if is_worse(job["bytes_read"]["base"], job["bytes_read"]["head"], BYTES):
        found.append("bytes read")
    counts = job.get("instructions") or {}
    if None not in (counts.get("base"), counts.get("head")) and is_worse(counts["base"], counts["head"], INSTRUCTIONS):
        found.append("instructions")
    return found


def pair(base, head, unit, digits):
    if base is None or head is None:
        return ["–", "–", ""]
    change = f"{100 * (head / base - 1):+.0f} %" if base else ""
    return [f"{base / unit:.{digits}f}", f"{head / unit:.{digits}f}", change]


def cells_of(job):
    if "failure" in job:
        return [job["name"], "failed: " + job["failure"]]
    base, head = (job["seconds"][side] for side in ("base", "head"))
    time = pair(median(base), median(head), 1e-3, 1)
    time[2] = f"{100 * (median(h / b for b, h in zip(base, head)) - 1):+.0f} %"
    memory = pair(*(median(job["peak_bytes"][side]) for side in ("base", "head")), 1 << 20, 1)
    counts = job.get("instructions") or {}
    name = job["name"] + (" (*)" if job.get("measured_again") else "")
    return [name, *time, *memory, *pair(job["bytes_read"]["base"], job["bytes_read"]["head"], 1e6, 2),
            *pair(counts.get("base"), counts.get("head"), 1e6, 1)]


def text_of(table):
    head = ["job"]
    for measure in ("ms", "peak MiB", "MB read", "million instructions"):
        head += [f"{measure}: {table['names'][0]}", table["names"][1], "change"]
    rows = [head] + [cells_of(job) for job in table["jobs"]]
    widths = [max(len(row[i]) for row in rows if len(row) == len(head)) for i in range(len(head))]
    lines = []
    for row in rows:
        if len(row) != len(head):
            lines.append(f"{row[0]:<{widths[0]}}  {row[1]}")
            continue
        lines.append("  ".join(f"{cell:<{w}}" if i == 0 else f"{cell:>{w}}"
                               for i, (cell, w) in enumerate(zip(row, widths))).rstrip())
    before, after = (table["load"] + table["load"])[:2]
    lines += ["", f"Medians of {table['rounds']} rounds in turns; phantom head, {table['voxels']} voxels per axis; "
              f"load {before:.1f} to {after:.1f}. A change of time is the median of the rounds' ratios."]
    if any(job.get("measured_again") for job in table["jobs"]):
        lines.append("(*): seemed slower, and was measured again, up to three times in twice as many rounds; the last ones count.")
    if table.get("instructions_left_out"):
        lines.append(f"Instructions are not counted: {table['instructions_left_out']}.")
    return "\n".join(lines)


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    try:
        with open(sys.argv[1], encoding="utf-8") as file:
            table = json.load(file)
        text = text_of(table)
        worse = [(job["name"], found) for job in table["jobs"] if (found := worse_figures(job))]
    except (OSError, ValueError, KeyError, TypeError) as failure:
        print(f"compare_jobs.py: '{sys.argv[1]}' is no table of measure_jobs.py: {failure!r}", file=sys.stderr)
        sys.exit(2)
    print(text)
    for name, found in worse:
        print(f"WORSE: {name}: {', '.join(found)}")
    print("no job is worse" if not worse else f"{len(worse)} of {len(table['jobs'])} jobs are worse")
    sys.exit(1 if worse else 0)


if __name__ == "__main__":
    main()
