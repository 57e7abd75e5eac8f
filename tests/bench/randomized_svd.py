"""randomized_svd.py FILE ROWS COLS RANK OVERSAMPLING POWER: scikit-learn's randomized_svd of a float32
matrix, column after column, with the settings given and with its own; seconds and relative error of
each as one JSON object."""
import json
import sys
import time

import numpy as np
from sklearn.utils.extmath import randomized_svd

path, rows, cols, rank, oversampling, power = sys.argv[1], *map(int, sys.argv[2:])
a = np.fromfile(path, np.float32).reshape(cols, rows).T


def error(u, s, vt):
    wrong = total = 0.0
    for first in range(0, cols, 256):
        part = a[:, first : first + 256]
        wrong += float(np.sum((part - (u * s) @ vt[:, first : first + 256]) ** 2, dtype=np.float64))
        total += float(np.sum(part**2, dtype=np.float64))
    return (wrong / total) ** 0.5


result = {}
for name, settings in {
    "same": {"n_oversamples": oversampling, "n_iter": power},
    "default": {},
}.items():
    start = time.perf_counter()
    factors = randomized_svd(a, rank, random_state=1, **settings)
    result[name + "_s"] = time.perf_counter() - start
    result[name + "_error"] = error(*factors)
print(json.dumps(result))
