"""The dashboard: what the archive and the incidents' folders know, as pages that work while the ledger is dead.

The pages are drawn whole by the investigator and are readable without a script; scripts only refresh what is shown
and ask before an act. A program in the browser was not chosen: whoever opens this has trouble already.
"""
