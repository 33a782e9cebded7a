"""A spare that is promoted, over a PostgreSQL server: the same tests as over a file."""

import pytest

from tests.integration.test_lone_spare import *  # noqa: F403  the tests and their fixtures, whichever there will be

pytestmark = pytest.mark.usefixtures("over_a_server")
