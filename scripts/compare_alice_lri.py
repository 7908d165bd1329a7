"""What PyPI's alice-lri does on KITTI scans, for the table in README.md: pip install alice-lri numpy; compare_alice_lri.py SCAN.bin ..."""

import sys
import time

import alice_lri
import numpy as np


def timed_ms(action, repeats=5):
    """The action's result and its shortest time in milliseconds."""
    best, result = float("inf"), None
    for _ in range(repeats):
        started = time.perf_counter()
        result = action()
        best = min(best, time.perf_counter() - started)
    return result, 1e3 * best


for path in sys.argv[1:]:
    points = np.fromfile(path, "<f4").reshape(-1, 4).astype(np.float64)
    x, y, z = (np.ascontiguousarray(points[:, k]) for k in range(3))
    sensor, estimate_ms = timed_ms(lambda: alice_lri.estimate_intrinsics(x, y, z), repeats=1)
    image, project_ms = timed_ms(lambda: alice_lri.project_to_range_image(sensor, x, y, z))
    back, back_ms = timed_ms(lambda: alice_lri.unproject_to_point_cloud(sensor, image))
    print(
        f"{path}: {image.height}x{image.width}, {len(x) - len(back[0])} of {len(x)} points lost, "
        f"estimate {estimate_ms / 1e3:.1f} s, projection {project_ms:.1f} ms, reconstruction {back_ms:.1f} ms"
    )
