"""What a careful user of OpenCV writes: find and refine the tags in a folder of pictures, in two processes.

    python detect.py FOLDER [DICTIONARY] [PROCESSES]

Prints pictures, tags and seconds. Needs opencv-contrib-python or Debian's python3-opencv.
"""

import glob
import sys
import time
from multiprocessing import Pool

import cv2

FOLDER = sys.argv[1]
DICTIONARY = sys.argv[2] if len(sys.argv) > 2 else "DICT_6X6_250"
PROCESSES = int(sys.argv[3]) if len(sys.argv) > 3 else 2


def start():
    global detector
    cv2.setNumThreads(1)
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARY))
    detector = cv2.aruco.ArucoDetector(dictionary, parameters)


def look(path):
    ids = detector.detectMarkers(cv2.imread(path, cv2.IMREAD_GRAYSCALE))[1]
    return 0 if ids is None else len(ids)


if __name__ == "__main__":
    pictures = sorted(p for kind in ("png", "jpg", "pgm") for p in glob.glob(f"{FOLDER}/**/*.{kind}", recursive=True))
    with Pool(PROCESSES, start) as pool:
        pool.map(look, pictures[:4])
        began = time.time()
        tags = sum(pool.imap_unordered(look, pictures, 16))
        seconds = time.time() - began
    print(f"{len(pictures)} pictures, {tags} tags, {seconds:.2f} s, {len(pictures) / seconds:.0f} pictures a second")
