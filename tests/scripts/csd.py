"""H1 by scipy.signal, for comparison with the program's own.

usage: csd.py SAMPLES.csv SEGMENT SAMPLE_TIME

SAMPLES.csv holds input and output, one pair a line, without a header. Prints frequency, real and imaginary part of H1
and the coherence, one line each, and on standard error the time that the estimate took. Exits with 77 when scipy is not
installed.
"""

import sys
import time

try:
    import numpy as np
    from scipy import signal
except ImportError:
    sys.exit(77)

path, segment, sample_time = sys.argv[1], int(sys.argv[2]), float(sys.argv[3])
u, y = np.loadtxt(path, delimiter=",", unpack=True)
settings = {"fs": 1 / sample_time, "window": "hann", "nperseg": segment, "noverlap": segment // 2, "detrend": "constant"}
times = []
for _ in range(5):
    start = time.perf_counter()
    frequency, cross = signal.csd(u, y, **settings)
    _, power = signal.welch(u, **settings)
    h1 = cross / power
    times.append(time.perf_counter() - start)
_, coherence = signal.coherence(u, y, **settings)
for row in zip(frequency, h1, coherence):
    print(f"{row[0]!r} {row[1].real!r} {row[1].imag!r} {row[2]!r}".replace("np.float64(", "").replace(")", ""))
print(f"scipy: {min(times) * 1e3:.2f} ms", file=sys.stderr)
