import threading
import time

import numpy as np
import pytest

from bokehnet.errors import BokehnetError, RenderCancelled
from bokehnet.studio.background import BackgroundProcess

# More than a pipe holds.
_LARGE = 1 << 22


def slow_large_answer(*, report):
    time.sleep(0.5)
    return np.ones(_LARGE, np.uint8)


def total(values, *, report):
    return int(values.sum())


@pytest.fixture
def background():
    process = BackgroundProcess(modules=[__name__])
    yield process
    process.stop()


def test_a_large_answer_of_a_cancelled_task_does_not_block_the_next_task(background):
    """The process sends an answer that nobody awaits while the next task, too large for a pipe, is sent."""
    cancel = threading.Event()
    threading.Timer(0.2, cancel.set).start()
    assert background.run(total, np.ones(2, np.uint8)) == 2  # the process has started
    with pytest.raises(RenderCancelled):
        background.run(slow_large_answer, cancel=cancel)
    results = []
    values = np.ones(_LARGE, np.uint8)
    work = threading.Thread(target=lambda: results.append(background.run(total, values)), daemon=True)
    work.start()
    work.join(60)
    assert results == [_LARGE]


def test_tasks_that_are_cancelled_before_they_are_read_leave_the_pipe_whole(background):
    values = np.ones(_LARGE, np.uint8)
    cancel = threading.Event()
    cancel.set()
    for _ in range(3):
        with pytest.raises(RenderCancelled):
            background.run(total, values, cancel=cancel)
    assert background.run(total, values) == _LARGE


def test_a_process_that_dies_is_replaced(background):
    assert background.run(total, np.ones(3, np.uint8)) == 3
    background.stop()
    assert background.run(total, np.ones(_LARGE, np.uint8)) == _LARGE


def test_a_time_limit_ends_the_task(background):
    with pytest.raises(BokehnetError, match=r"within 0\.1 s"):
        background.run(slow_large_answer, seconds=0.1)
    assert background.run(total, np.ones(3, np.uint8)) == 3
