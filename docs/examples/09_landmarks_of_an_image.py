"""People and their landmarks in single images, without any calibration.

    python 09_landmarks_of_an_image.py video.mp4

Uses the first frame of a video; any RGB array of uint8 will do.
"""

import sys

import av

import muybridge

with av.open(sys.argv[1]) as video:
    image = next(video.decode(video=0)).to_ndarray(format="rgb24")

people = muybridge.PersonDetector().detect(image)
print(f"{len(people)} people with confidence {people.confidence.round(2)}")

network = muybridge.KeypointNetwork()
found = network.locate(image, people.boxes_px)
for person in range(len(found)):
    for j, name in enumerate(network.landmarks.names):
        x, y = found.points_px[person, j]
        print(f"{name:16s} {x:7.1f} {y:7.1f}  +- {found.sd_px[person, j]:.1f} px, "
              f"confidence {found.confidence[person, j]:.2f}")  # fmt: skip
