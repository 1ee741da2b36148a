"""Export bags as Parquet tables.

Modules in the order of use:

- `units`: units of the columns, by the names of fields and labels
- `message_types`: definitions of the recorded message types, and messages decoded by them
- `columns`: a message type as Arrow columns
- `tables`: messages of any type, and of those with a table of their own, as rows
- `cloud_tables`: points of clouds as rows, each row of the exchange once
- `parquet_file`: a Parquet file that is written in parts and complete once it has its name
- `output_folder`: the folder of the tables, empty or with a former export
- `topic_writer`: writes the messages of one topic as a table
- `export`: all topics of a bag
"""

from earthmoving_sim.bag_export.export import BagExport, check_export, export_bag
from earthmoving_sim.bag_export.topic_writer import ExportedTopic

__all__ = ["BagExport", "ExportedTopic", "check_export", "export_bag"]
