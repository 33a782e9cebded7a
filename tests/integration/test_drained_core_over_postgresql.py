"""A core that is drained, over a PostgreSQL server: the same tests as over a file."""

import pytest

from tests.integration.test_drained_core import *  # noqa: F403  the tests and their fixtures, whichever there will be

pytestmark = pytest.mark.usefixtures("over_a_server")
