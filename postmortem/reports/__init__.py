"""One report, printed as JSON for programs and as Markdown for people."""
