"""Whose corners are right where cellmap and the AprilTag photographs' expected corners differ?

    python photographs.py FOLDER CELLMAP

FOLDER holds images/0.jpg .. 2.jpg and expected_corners.csv (image,tag place,..,corner,u,v), CELLMAP is the program. All tags carry id 0, so each is cut out
and detected alone. The judge is neither's: a picture of the whole tag, every cell of it, is drawn through a perspective map, blurred, lit with a
gradient and a tone, and fitted to the grey values by robust least squares (scipy). Reported: how far either's corners are from the fitted ones, and how
well a picture drawn through either's corners explains the grey values. Needs numpy, scipy, opencv-contrib-python-headless.
"""

import csv
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.optimize import least_squares

FOLDER, CELLMAP = Path(sys.argv[1]), Path(sys.argv[2]).resolve()
SIDE, OVER, PAD = 200, 5, 4
LAYOUT = """cellmap: 1
units: {length: mm, angle: deg}
world: eye
cameras:
  eye:
    images: "{configuration:04}.png"
    intrinsics: {model: pinhole, size: [200, 200], focal: [900, 900], centre: [99.5, 99.5]}
targets:
  tag: {tags: {dictionary: apriltag_36h11, size: 100, ids: [0]}, moves: true}
"""

pictures = [cv2.imread(str(FOLDER / f"images/{image}.jpg"), cv2.IMREAD_GRAYSCALE) for image in range(3)]
expected = {}
with open(FOLDER / "expected_corners.csv") as file:
    for row in list(csv.reader(file))[1:]:
        expected.setdefault((int(row[0]), int(row[1])), np.zeros((4, 2)))[int(row[4])] = float(row[5]), float(row[6])

# The tag with a margin of two cells. OpenCV keeps this family turned by half a turn.
dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
cells = np.ones((12, 12))
cells[2:10, 2:10] = cv2.aruco.generateImageMarker(dictionary, 0, 8, borderBits=1)[::-1, ::-1] > 128


def detect():
    """Corners by cellmap, of each tag cut out alone."""
    with tempfile.TemporaryDirectory() as folder:
        folder, origins = Path(folder), []
        for number, (place, corners) in enumerate(sorted(expected.items())):
            picture, middle = pictures[place[0]], corners.mean(0)
            reach = int(np.abs(corners - middle).max() * 1.9 + 4)
            left, top = (max(0, int(round(value)) - reach) for value in middle)
            right, bottom = (int(round(value)) + reach for value in middle)
            crop = picture[top : min(bottom, top + SIDE), left : min(right, left + SIDE)]
            # Nothing of its neighbours, which carry the same id.
            y, x = np.mgrid[0 : crop.shape[0], 0 : crop.shape[1]]
            a, b = cells_of(corners, x + left, y + top)
            own = (a > -2.5) & (a < 10.5) & (b > -2.5) & (b < 10.5)
            canvas = np.full((SIDE, SIDE), int(np.median(crop)), np.uint8)
            canvas[: crop.shape[0], : crop.shape[1]][own] = crop[own]
            cv2.imwrite(str(folder / f"{number:04}.png"), canvas)
            origins.append((place, (left, top)))
        (folder / "layout.yaml").write_text(LAYOUT)
        subprocess.run([CELLMAP, "detect", "layout.yaml", "--out", "out.csv"], cwd=folder, check=True, capture_output=True)
        found = {}
        with open(folder / "out.csv") as file:
            for row in csv.DictReader(file):
                place, origin = origins[int(row["configuration"])]
                corner = float(row["u"]) + origin[0], float(row["v"]) + origin[1]
                found.setdefault(place, np.full((4, 2), np.nan))[int(row["corner"])] = corner
        return {place: corners for place, corners in found.items() if not np.isnan(corners).any()}


def cells_of(corners, x, y):
    """Places of the picture in cells."""
    rows = []
    for (a, b), (u, v) in zip([(0, 0), (8, 0), (8, 8), (0, 8)], corners):
        rows += [[a, b, 1, 0, 0, 0, -u * a, -u * b, -u], [0, 0, 0, a, b, 1, -v * a, -v * b, -v]]
    inverse = np.linalg.inv(np.linalg.svd(np.array(rows))[2][-1].reshape(3, 3))
    a, b, depth = (row[0] * x + row[1] * y + row[2] for row in inverse)
    return a / depth, b / depth


def residuals(picture, around, corners, blur):
    """Grey values that a tag drawn through `corners` leaves unexplained; the pixels are those around the corners `around`."""
    low = np.maximum(np.floor(around.min(0) - 3).astype(int), 0)
    high = np.minimum(np.ceil(around.max(0) + 4).astype(int), picture.shape[::-1])
    width, height = high - low
    y, x = np.mgrid[0 : (height + 2 * PAD) * OVER, 0 : (width + 2 * PAD) * OVER]
    a, b = cells_of(corners, (x + 0.5) / OVER - 0.5 - PAD + low[0], (y + 0.5) / OVER - 0.5 - PAD + low[1])
    light = cells[np.clip(np.floor(b) + 2, 0, 11).astype(int), np.clip(np.floor(a) + 2, 0, 11).astype(int)]
    light = gaussian_filter(light, blur * OVER)
    light = light.reshape(height + 2 * PAD, OVER, width + 2 * PAD, OVER).mean((1, 3))[PAD:-PAD, PAD:-PAD]
    y, x = np.mgrid[low[1] : high[1], low[0] : high[0]]
    a, b = cells_of(around, x, y)
    inside = (a > -0.6) & (a < 8.6) & (b > -0.6) & (b < 8.6)
    x, y = (x - around[:, 0].mean()) / 20, (y - around[:, 1].mean()) / 20
    linear = np.stack([np.ones_like(light), x, y, light, light * x, light * y, light * (1 - light)], -1)[inside]
    grey = picture[low[1] : high[1], low[0] : high[0]][inside].astype(float)
    return grey - linear @ np.linalg.lstsq(linear, grey, rcond=None)[0]


def unexplained(picture, around, corners):
    return min(np.sqrt((residuals(picture, around, corners, blur) ** 2).mean()) for blur in (0.2, 0.4, 0.6, 0.8, 1.0, 1.3))


found, rows = detect(), []
for place, corners in sorted(found.items()):
    picture, reference = pictures[place[0]], expected[place]

    def misfit(unknowns):
        return residuals(picture, reference, unknowns[:8].reshape(4, 2), np.clip(unknowns[8], 0.1, 2))

    start = np.append(corners.ravel(), 0.5)
    fit = least_squares(misfit, start, loss="soft_l1", f_scale=8, diff_step=2e-4, max_nfev=25).x[:8].reshape(4, 2)
    grey = [unexplained(picture, reference, quad) for quad in (reference, corners)]
    far = [np.linalg.norm(quad - fit, axis=1) for quad in (reference, corners)]
    rows.append((grey, *far, np.linalg.norm(reference - corners, axis=1)))
    print(place, f"grey levels unexplained: expected {grey[0]:.1f}, cellmap {grey[1]:.1f}", end="; ")
    print(f"largest distance to the fit, px: expected {far[0].max():.2f}, cellmap {far[1].max():.2f}")

theirs, ours, apart = (np.concatenate([row[k] for row in rows]) for k in (1, 2, 3))
rms = lambda values: np.sqrt((values**2).mean())
print(f"{len(rows)} tags, {len(apart)} corners, {(apart > 0.5).sum()} of them more than 0.5 px apart")
print(f"distance to the fit, px: expected rms {rms(theirs):.3f} median {np.median(theirs):.3f}, {(theirs > 0.5).sum()} over 0.5;", end=" ")
print(f"cellmap rms {rms(ours):.3f} median {np.median(ours):.3f}, {(ours > 0.5).sum()} over 0.5")
print(f"of those apart nearer to the fit: cellmap {(ours < theirs)[apart > 0.5].sum()}")
print(f"grey values better explained by cellmap's corners: {sum(row[0][1] < row[0][0] for row in rows)} of {len(rows)} tags")
