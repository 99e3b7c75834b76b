"""Calls `dynamics.c`: simulation, rows of the inverse dynamics, mass matrix. The library is built once, beside the temporary files."""

import ctypes
import hashlib
import subprocess
import tempfile
from pathlib import Path

import numpy as np

KINDS = ("inertia", "link_inertia", "link_moment", "spring", "cubic", "damper", "drag", "friction", "input", "cogging", "place_friction",
         "offset")
MOST = 8
SUBSTEP = 1e-3


class _Machine(ctypes.Structure):
    _fields_ = [(name, ctypes.c_int) for name in ("n", "inputs", "elements", "links", "cart")] + [
        ("coordinate", ctypes.c_int * MOST), ("length", ctypes.c_double * MOST), ("smooth", ctypes.c_double * MOST),
        ("gravity", ctypes.c_double)]


class _Element(ctypes.Structure):
    _fields_ = [("kind", ctypes.c_int), ("i", ctypes.c_int), ("j", ctypes.c_int), ("first", ctypes.c_double), ("second", ctypes.c_double)]


class _Channel(ctypes.Structure):
    _fields_ = [("late", ctypes.c_int)] + [(name, ctypes.c_double * MOST) for name in ("dead", "play", "count")]


def _build():
    source = Path(__file__).with_name("dynamics.c").read_bytes()
    library = Path(tempfile.gettempdir()) / f"arena-{hashlib.sha256(source).hexdigest()[:16]}.so"
    if not library.exists():
        with tempfile.TemporaryDirectory(dir=library.parent) as folder:
            built = Path(folder) / "dynamics.so"
            flags = ["-O3", "-march=native", "-ffast-math", "-fno-finite-math-only", "-shared", "-fPIC"]
            subprocess.run(["cc", *flags, "-o", built, "-x", "c", "-", "-lm"], input=source, check=True)
            built.rename(library)
    return ctypes.CDLL(str(library))


_library = _build()
_pointer = lambda a: None if a is None else a.ctypes.data_as(ctypes.c_void_p)
_flat = lambda a: np.ascontiguousarray(a, dtype=float)


class Dynamics:
    """`layout` has n, inputs, coordinate and length (of links), cart, smooth and gravity; elements have kind, i, j, first, second."""

    def __init__(self, layout, elements):
        self.n, self.inputs, self.elements = layout["n"], layout["inputs"], len(elements)
        m = self.machine = _Machine()
        m.n, m.inputs, m.elements, m.cart = self.n, self.inputs, len(elements), layout["cart"]
        m.links, m.gravity = len(layout["coordinate"]), layout["gravity"]
        for field in ("coordinate", "length", "smooth"):
            for k, value in enumerate(layout[field]):
                getattr(m, field)[k] = value
        self.list = (_Element * len(elements))(*[
            _Element(KINDS.index(e["kind"]), e["i"], e["j"], e.get("first", 0), e.get("second", 0)) for e in elements])

    def simulate(self, theta, sample, q0, v0, inputs=None, loop=None, noise=None, late=0, dead=(), play=(), count=()):
        """Readings and inputs at every sample, or None when the motion leaves every bound.

        Plays `inputs`, or closes a `loop`: reference, driven coordinates, gains of errors and of their rates, time constant of the rates.
        """
        channel = _Channel(late=late)
        for name, values in (("dead", dead), ("play", play), ("count", count)):
            for k, value in enumerate(values):
                getattr(channel, name)[k] = value
        if loop is None:
            inputs, rest = _flat(inputs), (None, None, None, None, ctypes.c_double(0))
            samples = len(inputs)
        else:
            reference, driven, kp, kd = _flat(loop[0]), np.array(loop[1], dtype=np.int32), _flat(loop[2]), _flat(loop[3])
            samples = len(reference)
            inputs = np.zeros((samples, self.inputs))
            rest = (_pointer(reference), _pointer(driven), _pointer(kp), _pointer(kd), ctypes.c_double(loop[4]))
        readings = np.empty((samples, self.n))
        theta, q0, v0, noise = _flat(theta), _flat(q0), _flat(v0), None if noise is None else _flat(noise)
        lost = _library.simulate(
            ctypes.byref(self.machine), self.list, _pointer(theta), ctypes.byref(channel), samples, max(1, round(sample / SUBSTEP)),
            ctypes.c_double(sample), _pointer(q0), _pointer(v0), _pointer(noise), *rest, _pointer(inputs), _pointer(readings))
        return None if lost else (readings, inputs)

    def rows(self, q, v, a, u):
        """What every element asks for at unit value: samples x coordinates x elements."""
        q, v, a, u = _flat(q), _flat(v), _flat(a), _flat(u)
        out = np.empty((len(q), self.n, self.elements))
        _library.rows(ctypes.byref(self.machine), self.list, len(q), _pointer(q), _pointer(v), _pointer(a), _pointer(u), _pointer(out))
        return out

    def mass(self, theta, q):
        theta, q, out = _flat(theta), _flat(q), np.empty((self.n, self.n))
        _library.mass(ctypes.byref(self.machine), self.list, _pointer(theta), _pointer(q), _pointer(out))
        return out
