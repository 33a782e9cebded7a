"""The sender: takes what the guard has to say and brings it to people, in a process of its own.

Sending means names to look up, strangers to wait for and their answers to read: none of that may ever hold up or hurt
whoever guards the ledger. So the guard only puts a file into a folder, and this process, which may hang, die or be
missing, does the rest. It is the standard library and msgspec alone; Apprise, where somebody has it, runs in one more process.
"""
