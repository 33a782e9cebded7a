"""Reading: the file a bank gave becomes a table, and each row of it a candidate, a refusal or a skip.

The idea is two halves. The first (`child`, run as `python -I -m core.imports.reading`) opens the file in a
process of its own with limits, because a spreadsheet is a program's input written by strangers: it may be
locked, a bomb, or simply broken, and the ledger must not die of it. It writes plain text cells to a file and
is gone. The second half is pure: formats are data, a mapping says which column is what, and every row is
judged by itself. Nothing is guessed from one cell; what a file can't say as a whole is asked of the person.

What the life of an import calls:

- `child.read_in_child(path, *, encoding, password, out, limits) -> ReadTable | Unreadable`
- `kept.open_table(out) -> ReadTable | Unreadable`: a table read earlier, for example after a death
- `formats.builtin_formats() -> Mapping[str, Format]`
- `proposal.propose(table, formats, wanted=None) -> Proposal`
- `mapping.faults_of(mapping, columns) -> tuple[MappingFault, ...]`
- `rows.parse_rows(table, mapping, format_, account_currency, header_format) -> Iterator[Result]`
- `fingerprints.fingerprint(account, candidate) -> str`
- `balance.BalanceCheck().see(result)`, one by one, then its `verdict`
"""
