"""Options of the augmentation of training crops."""

from dataclasses import dataclass


@dataclass(frozen=True)
class AugmentOptions:
    """Probabilities and standard deviations of the augmentation.

    Attributes:
        padding: side of the crop relative to the longer side of the person's bounding box.
        scale_sd: standard deviation of the logarithm of the person's size in the crop.
        shift_sd: standard deviation of the person's position, as a share of the crop.
        rotation_sd_deg: standard deviation of the roll that remains after gravity alignment.
        tumble: share of crops rolled by any angle up to 60 degrees.
        second_person: share of crops with another person beside the subject.
        embrace: share of crops with another person right behind or in front of the subject, as in a hold, whose limbs
            show where the subject's own are hidden. A network trained with it on crops of one size fails at others
            (docs/development/training-log.md).
        occluder: share of crops with objects in front of the person.
        mosaic: share of crops with a pixelated face.
        truncate: share of crops that extend over one border of the picture (black there).
        framed: share of crops of people who fill the picture or are cut off by it, see `occlusion.frame_people`.
        loose: share of crops whose box is 10 to 25 % larger or smaller than the person, and shifted, as detectors give
            them.
        far: share of crops of people who are 40 to 150 px tall in the picture.
        crisp: share of crops from large pictures that were sharpened.
        close_up: share of crops that frame part of a person, see `close_ups`.
        clutter: share of crops with objects behind the person, see `clutter`.
        plate: share of crops with the difference to the background model, see `background_difference`.
        backdrop: share of crops in front of a curtain, a screen or a bare wall, see `backgrounds`.
        dark: share of underexposed crops, down to a tenth of the light.
        tinted: share of crops in coloured light that no white balance removed.
        monochrome: share of crops from a camera or film without colour, see `film`.
        toned: share of crops from pictures in tones of one colour, such as sepia.
        faded: share of crops from faded colour film.
        scene_others: how often further people and objects are added in front of and behind renders of scenes, which
            have their own, relative to renders of one person.
        static_things: share of the renders of scenes whose things are part of the background model.
        faults: add camera faults, see `camera_faults`.
    """

    padding: float = 1.25
    scale_sd: float = 0.12
    shift_sd: float = 0.045
    rotation_sd_deg: float = 7.0
    tumble: float = 0.06
    second_person: float = 0.22
    embrace: float = 0.12
    occluder: float = 0.35
    mosaic: float = 0.08
    truncate: float = 0.08
    framed: float = 0.18
    loose: float = 0.25
    far: float = 0.08
    crisp: float = 0.06
    close_up: float = 0.1
    clutter: float = 0.5
    plate: float = 0.5
    backdrop: float = 0.08
    dark: float = 0.05
    tinted: float = 0.06
    monochrome: float = 0.08
    toned: float = 0.04
    faded: float = 0.04
    scene_others: float = 0.3
    static_things: float = 0.5
    faults: bool = True


# For scores and for fitting variances: whole people, without the rarer difficulties.
WHOLE = AugmentOptions(
    truncate=0.12, framed=0, loose=0, far=0, crisp=0, close_up=0, embrace=0, backdrop=0, dark=0, tinted=0,
    monochrome=0, toned=0, faded=0,
)  # fmt: skip
