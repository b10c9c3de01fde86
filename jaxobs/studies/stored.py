"""The files of a stored study as Zarr reads them: those of chunks that are done, each checked when it is read."""

from typing import Any

from zarr.abc.store import ByteRequest
from zarr.core.buffer import Buffer, BufferPrototype
from zarr.storage import LocalStore, WrapperStore

from jaxobs.studies.durable import StoreError, explained, fingerprint


class Done(WrapperStore[LocalStore]):
    """The files of `study` (a Store), read only. Those of chunks that are not in `done` are hidden, so they read as NaN."""

    def __init__(self, study: Any, done: set[int]) -> None:
        super().__init__(LocalStore(study.path, read_only=True))
        self.study, self.done = study, done

    def _with_store(self, store: LocalStore) -> "Done":
        return Done(self.study, self.done)

    async def get(self, key: str, prototype: BufferPrototype, byte_range: ByteRequest | None = None) -> Buffer | None:
        """What the file `key` holds; StoreError if it is not what was written."""
        name, _, file = key.rpartition("/")
        if name not in self.study.shapes or file == "zarr.json":
            return await super().get(key, prototype, byte_range)
        chunk = self.study.chunk_of(file)
        if chunk not in self.done:
            return None
        with explained(self.study.path, f"reading chunk {chunk}"):
            buffer = await super().get(key, prototype)
        files = self.study.files_of(chunk)
        if files is None or buffer is None or fingerprint(buffer.to_bytes()) != files[name]:
            fix = "Call study() with this store: it finds what is damaged and computes it again."
            raise StoreError(f"store {self.study.path}: {key} of chunk {chunk} is missing or damaged. {fix}")
        return buffer if byte_range is None else await super().get(key, prototype, byte_range)
