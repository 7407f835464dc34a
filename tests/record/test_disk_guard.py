"""A warning before the disk is full, an end in order when it is."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from archive_samples import CAM1, archive, files, film, numbers
from record_samples import Clock

from rsenf.errors import EXIT_FAILED, RecordingError
from rsenf.record import open_recording
from rsenf.record.limits import DiskGuard, DiskLimits, Usage

VIDEO = f"{CAM1}/video"
MB = 1_000_000


class Disk:
    """A disk of 10 GB that is filled by hand."""

    def __init__(self, free_mb):
        self.free_mb, self.now_s, self.said = free_mb, 0.0, []
        self.guard = DiskGuard(
            Path("/data"),
            DiskLimits(warn_mb=500, stop_mb=50),
            self.said.append,
            usage=lambda folder: Usage(10_000 * MB, round(self.free_mb * MB)),
            clock_s=lambda: self.now_s,
        )

    def after(self, seconds, free_mb):
        self.now_s, self.free_mb = self.now_s + seconds, free_mb
        self.guard.check()


def test_a_warning_once_with_the_time_that_is_left():
    disk = Disk(2000)
    disk.after(0, 2000)
    disk.after(600, 1000)
    assert disk.said == []
    disk.after(360, 400)
    disk.after(60, 300)
    assert disk.said == ["/data: 400 MB are left on the disk, enough for 4 minutes"]
    disk.after(60, 900)  # somebody has made room
    disk.after(60, 499)
    assert len(disk.said) == 2


def test_the_end_before_the_disk_is_full():
    disk = Disk(51)
    disk.after(0, 51)
    with pytest.raises(RecordingError) as caught:
        disk.after(5, 49.9)
    assert str(caught.value) == (
        "/data: the disk is full but for 49.9 MB; recording stopped, and what was recorded is "
        "whole (free some space on that disk, then record on)"
    )
    assert caught.value.exit_code == EXIT_FAILED


def test_it_looks_once_a_second():
    disk = Disk(2000)
    disk.after(0, 2000)
    disk.after(0.9, 1)
    with pytest.raises(RecordingError):
        disk.after(0.2, 1)


def test_limits_of_a_small_disk():
    said = []
    free = [31 * MB]
    guard = DiskGuard(
        Path("/data"),
        DiskLimits(),
        said.append,
        usage=lambda folder: Usage(300 * MB, free[0]),
        clock_s=iter(range(9)).__next__,
    )
    guard.check()
    assert said == []
    free[0] = 4 * MB
    guard.check()
    assert len(said) == 1
    free[0] = 2 * MB
    with pytest.raises(RecordingError):
        guard.check()


def film_on(root, look, step, size, cameras=(CAM1,)):
    """Film, and look at the disk every few frames, until that raises."""
    clock = Clock()
    with archive(root, clock) as recorder:
        for begin in range(0, 10_000, step):
            film(recorder, clock, range(begin, begin + step), cameras, size)
            look(begin)


def test_all_files_of_an_archive_are_whole_when_the_guard_stops_it(tmp_path):
    disk = Disk(1000)

    def look(begin):
        disk.after(2, 1000 - begin * 2)

    with pytest.raises(RecordingError):
        film_on(tmp_path, look, 10, 200, (CAM1, "rsenf/lab/cam2"))
    assert len(files(tmp_path)) == 2
    for path in files(tmp_path):
        recording = open_recording(path)
        assert recording.complete
        assert not recording.loss
    assert numbers(files(tmp_path)[0], VIDEO) == list(range(490))


@pytest.fixture
def tiny_disk(tmp_path):
    """A disk of 40 MB, all of it ours."""
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=40m", "tmpfs", str(tmp_path)], capture_output=True
    )
    if mounted.returncode:
        pytest.skip(f"may not mount a small disk here: {mounted.stderr.decode().strip()}")
    yield tmp_path
    subprocess.run(["umount", str(tmp_path)], check=True)


@pytest.mark.external
def test_a_real_disk(tiny_disk):
    said, seconds = [], iter(range(10_000))
    guard = DiskGuard(tiny_disk, DiskLimits(), said.append, clock_s=seconds.__next__)
    with pytest.raises(RecordingError, match="full but for 0"):
        film_on(tiny_disk, lambda _: guard.check(), 2, 20_000)
    assert len(said) == 1
    (path,) = files(tiny_disk)
    recording = open_recording(path)
    assert recording.complete
    assert not recording.loss
    seqs = numbers(path, VIDEO)
    assert seqs == list(range(len(seqs)))
    assert path.stat().st_size > 30 * MB
