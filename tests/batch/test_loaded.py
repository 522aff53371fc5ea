"""What the processes of a batch come of."""

import gc
import importlib
import sys


def test_all_that_is_named_is_there_and_garbage_is_collected_again():
    importlib.import_module("photonormal.batch.loaded")
    assert gc.isenabled() and "photonormal.view.show" in sys.modules
