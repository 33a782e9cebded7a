"""The only rooms that touch the operating system: clock, processes, folders, files, recorder pages."""
