"""`apply -o FILE.mcap`, read back by readers that share no code with the writer."""

import shutil
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

import tdfscal
from tests.cli.running import SAMPLES


@pytest.fixture(scope="module")
def applied(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the same wrenches as table and as recording, of 10 s of a log."""
    home = tmp_path_factory.mktemp("applied")
    shutil.copytree(SAMPLES / "parquet", home / "campaign")
    tdfscal.calibrate(home / "campaign", trials=0, output=home / "c.yaml")
    for name in ("w.parquet", "w.mcap"):
        tdfscal.apply(home / "c.yaml", home / "campaign", output=home / name, to="+10")
    return home


def frames(path: Path) -> set[str]:
    """Names in the headers of a recording."""
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return {decoded.header.frame_id for *_, decoded in reader.iter_decoded_messages()}


def test_wrenches_are_in_the_frames_of_the_exports(applied: Path, tmp_path: Path) -> None:
    tdfscal.simulate(tmp_path / "campaign", format="mcap", postures=3, rate=20.0)
    text = tdfscal.export(applied / "c.yaml", to="ros").text
    nodes = (node["ros__parameters"] for node in yaml.safe_load(text).values())
    sensors = {node["frame_id"] for node in nodes if "frame_id" in node}
    assert len(sensors) == 3
    assert frames(tmp_path / "campaign" / "log.mcap") == {"bcs", *sensors}
    urdf = ET.fromstring(tdfscal.export(applied / "c.yaml", to="urdf").text)
    assert {link.get("name") for link in urdf.iter("link")} == {"bcs", *sensors}
    (terminal,) = frames(applied / "w.mcap")
    assert f"# Frame {terminal}," in text
