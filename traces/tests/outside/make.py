"""Writes the files beside this one, as other programs do: `python make.py` with pandas, pyarrow and mcap[compression]."""

import datetime
import json

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from mcap.writer import CompressionType, Writer

ROWS = 6
frame = pd.DataFrame(
    {
        "time_ms": [0.5 * row for row in range(ROWS)],
        "mode": [row - 1 for row in range(ROWS)],
        "bus_v": [24.0 + row / 10 for row in range(ROWS)],
        "bridge_on": [row % 2 == 0 for row in range(ROWS)],
        "end": ["arrived"] * ROWS,
    }
)
frame.loc[3, "bus_v"] = None
frame.loc[4, "end"] = None

frame.to_parquet("pandas.parquet", index=False)  # snappy
for compression in ["gzip", "none", "zstd", "lz4", "brotli"]:
    own = None if compression == "none" else compression
    frame.to_parquet(f"pandas-{compression}.parquet", index=False, compression=own)
frame.to_parquet("pandas-unnamed-index.parquet", index=True)
frame.set_index("time_ms").to_parquet("pandas-time-index.parquet")

short = frame.astype({"time_ms": "float32", "bus_v": "float32", "mode": "int32"})
short.to_parquet("pandas-32-bit.parquet", index=False)
table = pa.Table.from_pandas(frame, preserve_index=False)
pq.write_table(table, "arrow-groups.parquet", row_group_size=2, use_dictionary=False, data_page_version="2.0")
for unit in ["ms", "us", "ns"]:
    start = datetime.datetime(2026, 11, 28)
    times = pd.Series([start + datetime.timedelta(milliseconds=ms) for ms in frame["time_ms"]])
    times = times.astype(f"datetime64[{unit}]")
    if unit == "ms":
        times = pd.Series([start + datetime.timedelta(milliseconds=row) for row in range(ROWS)])
        times = times.astype("datetime64[ms]")
    frame.assign(time_ms=times).to_parquet(f"pandas-{unit}.parquet", index=False)
spans = pd.to_timedelta(frame["time_ms"], unit="ms")
frame.assign(time_ms=spans).to_parquet("pandas-spans.parquet", index=False)
frame.assign(time_ms=[[0.0]] * ROWS).to_parquet("pandas-list.parquet", index=False)
numbers = {"a": pa.array([0, 255], pa.uint8()), "b": pa.array([0, 2**32 - 1], pa.uint32())}
pq.write_table(pa.table(numbers | {"c": pa.array([0, 2**63 - 1], pa.uint64())}), "arrow-unsigned.parquet")
pq.write_table(pa.table({"c": pa.array([0, 2**63], pa.uint64())}), "arrow-too-large.parquet")

frame.to_csv("pandas.csv")
frame.to_csv("pandas-semicolon.csv", sep=";", decimal=",", index=False)

for compression in [CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD]:
    # The layout of docs/traces.md, written by another library.
    with open(f"mcap-{compression.name.lower()}.mcap", "wb") as file:
        writer = Writer(file, compression=compression)
        writer.start()
        properties = {"time_ms": {"type": "number"}, "mode": {"type": "integer"}}
        schema = json.dumps({"type": "object", "properties": properties}).encode()
        schema = writer.register_schema("hil_sim.Trace", "jsonschema", schema)
        channel = writer.register_channel("/motor", "json", schema)
        columns = [
            {"name": "time_ms", "unit": "ms", "kind": "float", "nullable": False, "decimals": 1},
            {"name": "mode", "unit": "", "kind": "int", "nullable": False, "decimals": None},
        ]
        writer.add_metadata("trace", {"node": "4"})
        writer.add_metadata("columns", {"columns": json.dumps(columns), "facts": '["node"]'})
        for row in range(ROWS):
            data = json.dumps({"time_ms": 0.5 * row, "mode": row - 1}).encode()
            writer.add_message(channel, log_time=500_000 * row, publish_time=500_000 * row, data=data)
        writer.finish()
with open("mcap-other.mcap", "wb") as file:
    writer = Writer(file)
    writer.start()
    writer.finish()
