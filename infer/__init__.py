"""From session folders to motion, on onnxruntime: never imports torch."""
