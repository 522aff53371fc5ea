"""What takes long to load of all that measuring needs: the processes of a batch come of one that has imported this."""

import gc
from importlib import import_module

gc.disable()  # nothing of this is garbage: to look for some would take a quarter of the time
for name in (
    *("cv2", "numpy", "scipy.fft", "scipy.ndimage", "scipy.special", "torch"),
    *("photonormal.job", "photonormal.methods.engine", "photonormal.methods.engine.stream"),
    *("photonormal.methods.albedo", "photonormal.methods.expected", "photonormal.integration.quadratic"),
    *("photonormal.doctor.explanations", "photonormal.doctor.lights", "photonormal.doctor.motion"),
    *("photonormal.capture.folder", "photonormal.view.show"),
):
    import_module(name)
gc.freeze()
gc.enable()
