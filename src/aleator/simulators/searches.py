"""What else a store keeps: results of searches, which belong to the simulator that they ran on."""

from __future__ import annotations

import hashlib

from aleator.simulators import store_file
from aleator.simulators.store import Store


def kept(store: Store, fingerprint: str, key: str) -> str | None:
    """The text that was kept of a simulator under a key; None of none, or of one that is damaged.

    A store that cannot be written is not asked.
    """
    if not store.writable:
        return None
    with store_file.told(store.path):
        row = store.connection.execute(
            "SELECT text, digest FROM searches WHERE fingerprint = ? AND key = ?",
            (fingerprint, key),
        ).fetchone()
    return row[0] if row and row[1] == _digest(key, row[0]) else None


def keep(store: Store, fingerprint: str, key: str, text: str) -> None:
    """Keep a text of a simulator under a key."""
    if not store.writable:
        return
    with store_file.told(store.path), store_file.transaction(store.connection):
        store.connection.execute(
            "INSERT OR REPLACE INTO searches VALUES (?, ?, ?, ?)",
            (fingerprint, key, text, _digest(key, text)),
        )


def _digest(key: str, text: object) -> str:
    return hashlib.sha256(f"{key}{text}".encode()).hexdigest()
