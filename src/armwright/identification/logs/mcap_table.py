"""MCAP recordings as measured tables: messages sensor_msgs/JointState of one topic."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from armwright.errors import LogError, check_known
from armwright.identification.logs.log_file import FileTable
from armwright.identification.logs.measured_table import MeasuredTable, as_log_error
from armwright.reading import opened

JOINT_STATE = ("position", "velocity", "effort")  # fields of a message


class McapTable(MeasuredTable):
    """Messages sensor_msgs/JointState of one topic in an MCAP recording, a row each."""

    def __init__(self, path: Path, table: FileTable):
        super().__init__(path, table)
        with opened(path, "an MCAP file", LogError) as file, as_log_error(path):
            reader = self._reader(file)
            self._topic = self._chosen_topic(reader)
            with contextlib.redirect_stderr(io.StringIO()):  # where the decoder tells about a damaged schema
                messages = (each.decoded_message for each in reader.iter_decoded_messages(topics=[self._topic]))
                first = next((message for message in messages if len(message.name)), None)
            if first is None:
                raise LogError("no messages that name joints", place="topic", value=self._topic, file=path)
            self._joints = list(first.name)
            fields = [field for field in JOINT_STATE if len(getattr(first, field))]
        self.names = ("stamp", "log_time", *(f"{field}/{joint}" for field in fields for joint in self._joints))
        self.units = {"stamp": "ns", "log_time": "ns"}

    def _reader(self, file: Any) -> Any:
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory

        return make_reader(file, decoder_factories=[DecoderFactory()])

    def _chosen_topic(self, reader: Any) -> str:
        summary = reader.get_summary()
        channels = [] if summary is None else summary.channels.values()
        schemas = {} if summary is None else summary.schemas
        names = [
            c.topic for c in channels if c.schema_id in schemas and schemas[c.schema_id].name.endswith("JointState")
        ]
        topic = self.table.topic or (names[0] if len(names) == 1 else None)
        if topic is None:
            what = "several topics of sensor_msgs/JointState" if names else "no topic of sensor_msgs/JointState"
            raise LogError(what, place="topic", expected=f"one of {', '.join(names)}" if names else "", file=self.path)
        check_known(LogError, topic, names, "no topic of sensor_msgs/JointState", place="topic", file=self.path)
        return topic

    def blocks(self, columns: Sequence[int | str], rows: int) -> Iterator[list[np.ndarray]]:
        """See `MeasuredTable.blocks`."""
        names = [self._name(column) for column in columns]
        cells: list[list[float]] = []
        row = 0
        with opened(self.path, "an MCAP file", LogError) as file, as_log_error(self.path):
            for each in self._reader(file).iter_decoded_messages(topics=[self._topic]):
                cells.append(self._row(each, names, row))
                row += 1
                if len(cells) == rows:
                    yield [np.array(column) for column in zip(*cells, strict=True)]
                    cells = []
        if cells:
            yield [np.array(column) for column in zip(*cells, strict=True)]

    def _row(self, each: Any, names: list[str], row: int) -> list[float]:
        """The cells of one message; joints may stand in another order in each."""
        message, stamp = each.decoded_message, each.decoded_message.header.stamp
        known = {"stamp": stamp.sec * 10**9 + stamp.nanosec, "log_time": each.message.log_time}
        order = {joint: k for k, joint in enumerate(message.name)}
        cells = []
        for name in names:
            if name in known:
                cells.append(known[name])
                continue
            field, _, joint = name.partition("/")
            values = getattr(message, field)
            if joint not in order or order[joint] >= len(values):
                cells.append(float("nan"))
                continue
            cells.append(values[order[joint]])
        return cells
