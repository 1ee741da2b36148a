"""Recover bags that were cut off or damaged.

Modules in the order of use:

- `damaged_file`: finds the records of an MCAP file, also behind damaged ones
- `compressed_file`: decompresses a file that was compressed as a whole, as far as its data go
- `salvage`: what can be read of a file: schemas, channels, messages, attachments, and what cannot
- `output_folder`: the folder of the new bag, which is left as it was if nothing is written
- `recovered_bag`: writes what can be read of a bag as another bag
"""

from msg_bridge.bag_recovery.recovered_bag import RecoveredBag, RecoveredFile, recover_bag

__all__ = ["RecoveredBag", "RecoveredFile", "recover_bag"]
