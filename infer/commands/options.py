"""Which fields of options classes are options of the command line; the others are set from Python alone.

The keys are names, since importing the classes takes longer than printing the help; a test compares them with the
classes themselves.
"""

# Classes whose options have no prefix: `--calibration`, not `--session.calibration`.
WITHOUT_PREFIX = frozenset(
    {
        "AdaptOptions", "BoardChoice", "BoardOptions", "DetectOptions", "DiagnosisOptions", "MarkerVideoOptions",
        "PeopleCalibrationOptions", "RunOptions", "ScanOptions", "SessionOptions", "SolveOptions",
        "SolvePointsOptions",
    }
)  # fmt: skip

# Classes of which the command line has these fields alone; classes that are not named here are there with all of them.
COMMAND_LINE: dict[str, tuple[str, ...]] = {
    # 2D landmarks
    "KeypointOptions": ("people", "track", "onnx", "refine_crop", "most_fps", "min_confidence"),
    "PeopleOptions": ("min_score", "every", "background"),
    "TrackOptions": ("max_people", "start_score", "coast"),
    # one person in all cameras, and 3D points
    "TrackingOptions": ("gate", "start", "min_frames", "coast"),
    "RefinementOptions": ("enabled", "everywhere", "most_fps"),
    "FlipOptions": ("min_gain", "prior"),
    "TriangulateOptions": ("min_views", "min_angle_deg", "gate_sigma", "noise_px", "threads"),
    "ViewBiasOptions": ("enabled",),
    "PosePriorOptions": ("enabled", "one_view", "enough"),
    "SmoothOptions": ("method", "cutoff_hz", "acceleration", "max_gap", "extrapolate", "unflip", "top_speed"),
    # the fitted skeleton
    "FitOptions": ("model_sigma", "root_acceleration", "angular_acceleration", "prior_weight"),
    "MarkerFitOptions": ("noise_m", "root_acceleration", "angular_acceleration", "prior_weight"),
    # markers
    "BlobOptions": ("threshold", "least_px", "most_px", "roundness"),
    "CleanOptions": ("fill", "longest_s", "trust_m"),
    "MarkerVideoOptions": ("markerset", "shortest_s", "blobs", "match", "clean", "correct"),
    "MatchOptions": ("near_m", "error_px", "views"),
    # results and calibration
    "DiagnosisOptions": ("max_shift", "max_faults"),
    "OverlayOptions": ("crf", "preset", "legend"),
    "PeopleCalibrationOptions": ("height", "bones", "max_frames", "focal_sigma"),
}  # fmt: skip

# What a value is called in help, by class and field, where its type says little.
METAVARS: dict[str, str] = {
    "SessionOptions.cameras": "NAME [NAME ...]",
    "SolvePointsOptions.centres": (
        "{midpoint,plane,chord,harrington,bell,davis,hara,regressions,functional,file,body} ..."
    ),
}

# What an option is called in full, by class and field, where the names of field and class read badly together.
NAMES: dict[str, str] = {
    "OnnxOptions.device": "device",
    "PosePriorOptions.enabled": "pose-prior",
    "RefinementOptions.enabled": "refinement",
    "ViewBiasOptions.enabled": "view-bias",
}
