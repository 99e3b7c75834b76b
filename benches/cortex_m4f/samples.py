"""One period of the forces that Feng's Eqn 3.24 with m = 2, k1 = 40, k2 = 1.5 needs on the pattern, as a table in C."""
from math import cos, pi, sin

AMPLITUDE, FREQUENCY, SAMPLES = 0.3, 3.0, 1000
print(f"#define SAMPLES {SAMPLES}")
print("static const estimator_forces samples[SAMPLES] = {")
for i in range(SAMPLES):
    phase = 2 * pi * i / SAMPLES
    x = AMPLITUDE * (cos(phase) - cos(3 * phase) / 9)
    v = AMPLITUDE * FREQUENCY * (-sin(phase) + sin(3 * phase) / 3)
    a = AMPLITUDE * FREQUENCY**2 * (-cos(phase) + cos(3 * phase))
    print(f"    {{{2 * a + 40 * x + 1.5 * v * v!r}f}},")
print("};")
