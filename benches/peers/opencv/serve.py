"""OpenCV's `detectMarkers`, as a careful user calls it, on pictures that come through a pipe: one thread, corners refined with SUBPIX.

    python serve.py

For each line {"dictionary": "DICT_6X6_250", "width": 1280, "height": 720, "repeats": 3} and the grey bytes after it, answers with a line
{"ms": least time of a call, "ids": [...], "corners": [[[x, y] * 4], ...]}. The first line of all names the version.
Needs opencv-contrib-python-headless.
"""

import json
import sys
import time

import cv2
import numpy

cv2.setNumThreads(1)
parameters = cv2.aruco.DetectorParameters()
parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
detectors = {}

print(json.dumps({"version": cv2.__version__}), flush=True)
while line := sys.stdin.buffer.readline():
    asked = json.loads(line)
    size = asked["height"], asked["width"]
    picture = numpy.frombuffer(sys.stdin.buffer.read(size[0] * size[1]), numpy.uint8).reshape(size)
    name = asked["dictionary"]
    if name not in detectors:
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
        detectors[name] = cv2.aruco.ArucoDetector(dictionary, parameters)
    least = float("inf")
    for _ in range(asked["repeats"]):
        began = time.perf_counter()
        corners, ids, _ = detectors[name].detectMarkers(picture)
        least = min(least, time.perf_counter() - began)
    ids = [] if ids is None else ids.ravel().tolist()
    answer = {"ms": 1e3 * least, "ids": ids, "corners": [quad.reshape(4, 2).tolist() for quad in corners]}
    print(json.dumps(answer), flush=True)
