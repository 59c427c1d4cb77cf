"""
What reading a bag costs as it grows: time and peak memory for 1e3 to 1e7 messages, as JSON lines.

    python scripts/reading_growth.py > growth.jsonl

Every bag is read in a process of its own, after a small one; the memory is what comes on top of the program and its
libraries, told by Linux. Slopes of the logarithms over the last decade are told at the end.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from long_bag import COMPRESS, STORAGES, topics, write_long_bag

READ = """
import json, re, sys, time
from cfd_pneumatic.recording import read_recording, sampling

def memory(name):
    return 1024 * int(re.search(name + r':\\s+(\\d+)', open('/proc/self/status').read())[1])

small, large, in_memory = sys.argv[1:]
read_recording(small)
if in_memory:
    sampling.LONG = float('inf')
open('/proc/self/clear_refs', 'w').write('5')  # forget the peak of loading
before, begin = memory('VmRSS'), time.perf_counter()
recording = read_recording(large)
seconds = time.perf_counter() - begin
print(json.dumps({'seconds': seconds, 'peak_bytes': memory('VmHWM') - before}))
"""


def measure(small: Path, large: Path, in_memory: bool) -> dict[str, float]:
    """Return time and peak memory of reading a bag in a process that has read a small one before."""
    run = [sys.executable, '-c', READ, str(small), str(large), 'in memory' if in_memory else '']
    return json.loads(subprocess.run(run, check=True, capture_output=True, text=True).stdout)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--most', type=float, default=1e7, help='messages of the longest bag (default: 1e7)')
    parser.add_argument('--repeat', type=int, default=3, help='readings of each; the median counts (default: 3)')
    parser.add_argument('--compression', choices=COMPRESS, default='none', help='of the chunks of an mcap')
    parser.add_argument('--in-memory', action='store_true', help='keep long recordings in memory, too')
    options = parser.parse_args()
    for storage in STORAGES:
        rows = []
        for exponent in np.arange(3.0, np.log10(options.most) + 0.01, 0.5):
            samples = round(10**exponent / len(topics()))
            with TemporaryDirectory() as folder:
                small = write_long_bag(Path(folder) / 'small', 1000, storage, options.compression)
                large = write_long_bag(Path(folder) / 'large', samples, storage, options.compression)
                runs = [measure(small, large, options.in_memory) for _ in range(options.repeat)]
            cost = {name: float(np.median([run[name] for run in runs])) for name in runs[0]}
            rows.append({'storage': storage, 'messages': samples * len(topics()), **cost})
            print(json.dumps(rows[-1]), flush=True)
        last = [row for row in rows if row['messages'] > 0.05 * rows[-1]['messages']]
        for name in ('seconds', 'peak_bytes'):
            logs = np.log([(row['messages'], row[name]) for row in last])
            slope = np.polyfit(*logs.T, 1)[0]
            print(f'{storage}: {name} grow with messages to the power of {slope:.2f}', file=sys.stderr)


if __name__ == '__main__':
    main()
