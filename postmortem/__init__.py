"""The investigators: bundle in, findings and a report out. Imports neither the guard nor the guarded."""
