"""Where outputs go: devices and pipes are written to, links followed, and a failure leaves what was there.

Nodes are made here, in temporary folders; those of the machine are never named.
"""

import contextlib
import os
import pathlib
import socket
import stat
import subprocess
import sys
import threading
import time

import matplotlib.figure
import numpy as np
import pytest

import display_picture
import plots
import scene_io
from protocol import InputError

NULL, FULL = (1, 3), (1, 7)  # major and minor number


def node(path, numbers):
    """A device node, or a skip where making one is not allowed."""
    try:
        os.mknod(path, 0o666 | stat.S_IFCHR, os.makedev(*numbers))
        os.close(os.open(path, os.O_WRONLY))
    except PermissionError as error:
        pytest.skip(f"no device nodes here: {error}")
    return path


@contextlib.contextmanager
def small_disk(folder, size="64k", more=""):
    """A tmpfs of this size on `folder`, or a skip where mounting is not allowed."""
    folder.mkdir()
    done = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={size}{more}", "tmpfs", str(folder)],
        capture_output=True,
        text=True,
    )
    if done.returncode:
        pytest.skip(f"no mount here: {done.stderr.strip()}")
    try:
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def save_figure(path):
    """A figure as every plot writes it."""
    figure = matplotlib.figure.Figure()
    figure.add_subplot().plot(np.random.default_rng(1).random(2000))
    plots.save(figure, {"svg": str(path)}, ("svg",))


def save_blend(path):
    """A .blend with a megabyte of values that no compression makes smaller."""
    bpy = pytest.importorskip("bpy")
    from blender_file import open_empty
    from blender_file import save_blend as save

    open_empty()
    mesh = bpy.data.meshes.new("noise")
    mesh.vertices.add(100_000)
    mesh.vertices.foreach_set("co", np.random.default_rng(1).random(300_000, np.float32))
    mesh.use_fake_user = True
    save(str(path))


def save_grid(path):
    """A grid of noise."""
    pytest.importorskip("bpy")
    import volume_grid

    values = np.random.default_rng(1).random((32, 32, 32), np.float32)
    volume_grid.write(path, values, np.eye(4))


NOISE = np.random.default_rng(1).random((200, 200, 3), np.float32)
WRITERS = {
    "text": lambda path: display_picture.write_text(str(path), "x" * 200_000),
    "png": lambda path: display_picture.write_png(str(path), (255 * NOISE).astype(np.uint8)),
    "exr": lambda path: display_picture.write_exr(str(path), NOISE, ("R", "G", "B")),
    "svg": save_figure,
    "blend": save_blend,
    "vdb": save_grid,
}
ALL = pytest.mark.parametrize("kind", WRITERS)


@ALL
def test_a_device_is_written_to_and_stays_a_device(tmp_path, kind):
    null, full = node(tmp_path / f"null.{kind}", NULL), node(tmp_path / f"full.{kind}", FULL)
    WRITERS[kind](null)
    with pytest.raises(InputError) as error:
        WRITERS[kind](full)
    assert "No space" in error.value.found and error.value.place == str(full)
    for path, numbers in ((null, NULL), (full, FULL)):
        found = os.lstat(path)
        assert stat.S_ISCHR(found.st_mode) and found.st_rdev == os.makedev(*numbers)
    assert sorted(os.listdir(tmp_path)) == [full.name, null.name]


@ALL
def test_a_pipe_is_written_to_where_it_is_read(tmp_path, kind):
    pipe = tmp_path / f"pipe.{kind}"
    os.mkfifo(pipe)
    with pytest.raises(InputError) as error:
        WRITERS[kind](pipe)
    assert error.value.found == "a pipe that nobody reads"
    received = []
    reader = threading.Thread(target=lambda: received.append(pipe.read_bytes()))
    reader.start()
    time.sleep(0.5)  # until it waits for a writer
    WRITERS[kind](pipe)
    reader.join(10)
    WRITERS[kind](tmp_path / f"file.{kind}")
    size = (tmp_path / f"file.{kind}").stat().st_size
    assert abs(len(received[0]) - size) <= size * 0.01
    assert stat.S_ISFIFO(os.lstat(pipe).st_mode)


@ALL
def test_a_link_is_followed_and_the_file_behind_it_replaced(tmp_path, kind):
    (tmp_path / "elsewhere").mkdir()
    target = tmp_path / "elsewhere" / f"target.{kind}"
    target.write_text("before")
    target.chmod(0o600)
    link, dangling = tmp_path / f"link.{kind}", tmp_path / f"dangling.{kind}"
    link.symlink_to(pathlib.Path("elsewhere") / target.name)
    dangling.symlink_to(pathlib.Path("elsewhere") / f"new.{kind}")
    WRITERS[kind](link)
    WRITERS[kind](dangling)
    assert link.is_symlink() and dangling.is_symlink()
    assert target.stat().st_size > 100 and stat.S_IMODE(target.stat().st_mode) == 0o600
    assert stat.S_IMODE(dangling.stat().st_mode) == 0o644
    assert sorted(os.listdir(tmp_path / "elsewhere")) == [f"new.{kind}", target.name]


@ALL
def test_folders_sockets_and_circles_are_rejected(tmp_path, kind):
    folder, circle, plug = tmp_path / f"folder.{kind}", tmp_path / f"circle.{kind}", tmp_path / f"s.{kind}"
    folder.mkdir()
    circle.symlink_to(circle.name)
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(plug))
        for path, found in (
            (folder, "a folder"),
            (circle, "links that lead in a circle"),
            (plug, "a socket"),
        ):
            with pytest.raises(InputError) as error:
                WRITERS[kind](path)
            assert error.value.found == found
    assert len(os.listdir(tmp_path)) == 3


@ALL
def test_a_full_disk_leaves_what_was_there_and_no_part_of_the_new(tmp_path, kind):
    with small_disk(tmp_path / "disk", "16k") as disk:
        target = disk / f"target.{kind}"
        target.write_text("before")
        with pytest.raises(InputError) as error:
            WRITERS[kind](target)
        assert error.value.place == str(target)
        assert target.read_text() == "before" and os.listdir(disk) == [target.name]


@ALL
def test_a_folder_that_is_read_only(tmp_path, kind):
    with small_disk(tmp_path / "disk") as disk:
        target = disk / f"target.{kind}"
        target.write_text("before")
        subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
        with pytest.raises(InputError) as error:
            WRITERS[kind](target)
        assert error.value.place == str(target) and "ead-only" in error.value.found
        assert target.read_text() == "before"


def test_what_the_process_has_open_is_written_to(tmp_path):
    script = "import scene_io\nwith scene_io.replaced_file('/proc/self/fd/1') as name: name.write_text('out')"
    blend = str(pathlib.Path(scene_io.__file__).parent)
    command = [sys.executable, "-c", f"import sys; sys.path.insert(0, {blend!r})\n{script}"]
    assert subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout == b"out"
    with open(tmp_path / "log", "wb") as log:
        log.write(b"before ")
        log.flush()
        subprocess.run(command, stdout=log, check=True)
    assert (tmp_path / "log").read_bytes() == b"before out"
