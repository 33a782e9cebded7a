"""Opens OLE files: an old workbook is one, and so is a locked new one, which is decrypted in memory.

The password is in this process's memory and nowhere else, and so are the decrypted bytes. A missing and a
wrong password are told apart, because the person does different things about them.
"""

import io

import msoffcrypto  # type: ignore[import-untyped]  # it has no types
from msoffcrypto.exceptions import FileFormatError, InvalidKeyError  # type: ignore[import-untyped]  # as above

from core.imports.reading.limits import PASSWORD_CHARACTERS_MAX
from core.imports.reading.table import Unreadable, Why


def open_ole(data: bytes, password: str | None) -> bytes | Unreadable:
    """The bytes of a workbook that can be read: `data` itself, or what was locked in it."""
    try:
        return _open(data, password)
    except InvalidKeyError:
        return Unreadable(Why.WRONG_PASSWORD)
    except MemoryError:
        return Unreadable(Why.OUT_OF_MEMORY)
    # It raises whatever a broken file makes it stumble over, from struct.error to KeyError.
    except Exception:  # noqa: BLE001 - the reason stands above
        return Unreadable(Why.UNREADABLE)


def _open(data: bytes, password: str | None) -> bytes | Unreadable:
    try:
        office = msoffcrypto.OfficeFile(io.BytesIO(data))
    except FileFormatError:
        return data  # nothing it knows how to lock: whether it is a workbook, the reader of workbooks says
    if not office.is_encrypted():
        return data
    if not password:
        return Unreadable(Why.LOCKED)
    if len(password) > PASSWORD_CHARACTERS_MAX:
        return Unreadable(Why.WRONG_PASSWORD)
    office.load_key(password=password, verify_password=True)
    opened = io.BytesIO()
    office.decrypt(opened)
    return opened.getvalue()
