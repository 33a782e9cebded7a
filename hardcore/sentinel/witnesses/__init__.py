"""One witness per file: each looks at a tick's facts and says a colour and why."""
