"""Everything that photonormal writes: files that belong together appear at once, or not at all.

`at_once` writes files of one folder, `write` one file; `recover` clears up what a killed run left in a folder, and
`in_use` shows whether another is at work there; `refuse_taken` and `refuse_filled` say before the work that a file or
a folder can't be written.
"""

from photonormal.disk.batch import Content, FileBatch, Inside, at_once, in_use, recover, write
from photonormal.disk.journal import PARTIAL
from photonormal.disk.locking import lock, uninterrupted
from photonormal.disk.refusals import InUse, identities, refuse_filled, refuse_folder, refuse_taken, unwritable

__all__ = [
    "PARTIAL",
    "Content",
    "FileBatch",
    "InUse",
    "Inside",
    "at_once",
    "identities",
    "in_use",
    "lock",
    "recover",
    "refuse_filled",
    "refuse_folder",
    "refuse_taken",
    "uninterrupted",
    "unwritable",
    "write",
]
