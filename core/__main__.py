"""`python -m core`."""

from core.main import cli

cli()
