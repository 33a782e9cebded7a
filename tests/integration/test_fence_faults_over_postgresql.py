"""The fence, over a PostgreSQL server: the same tests as over a file."""

import pytest

from tests.integration.test_fence_faults import *  # noqa: F403  the tests and their fixtures, whichever there will be
from tests.integration.test_fence_faults import STRACE

pytestmark = [
    pytest.mark.usefixtures("over_a_server"),
    pytest.mark.skipif(STRACE is None, reason="no strace here"),
]
