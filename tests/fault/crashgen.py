"""The disk states a power cut may leave, from a record of libcrashio.so.

A file is an inode: what was synced, and the changes since.  A folder's entries are durable once the
folder is synced.  At a cut everything synced is there, and of the rest any subset of pages, any of
them torn at any byte.  That is more than real file systems do to us (they keep more order), so
what survives here survives there.
"""
import random
import struct

HEAD = struct.Struct("<BBHIQQ")
PAGE = 4096


def read_log(path):
    """[(op, inode, offset, name, data)], in order."""
    data, at, out = open(path, "rb").read(), 0, []
    while at < len(data):
        op, _, name_length, inode, offset, length = HEAD.unpack_from(data, at)
        at += HEAD.size
        name = data[at:at + name_length].decode()
        at += name_length
        out.append((chr(op), inode, offset, name, data[at:at + length]))
        at += length
    return out


def apply(content, change):
    op, offset, data = change
    if op == "w":
        if len(content) < offset:
            content.extend(bytes(offset - len(content)))
        content[offset:offset + len(data)] = data
    elif op == "t":
        del content[offset:]
        content.extend(bytes(offset - len(content)))
    elif op == "f" and len(content) < offset:
        content.extend(bytes(offset - len(content)))


class File:
    def __init__(self):
        self.synced, self.pending = bytearray(), []

    def sync(self):
        for change in self.pending:
            apply(self.synced, change)
        self.pending = []


class Disk:
    """Everything up to a point of the record."""

    def __init__(self):
        self.files = {}             # inode -> File, while it has a name
        self.names = {}             # name now -> File or "dir"
        self.durable = {}           # name on disk -> File or "dir"
        self.pending = []           # [(folder, [(name, File or None), ...])]
        self.acks = 0

    def change_names(self, *entries):
        for name, file in entries:
            if file is None:
                self.names.pop(name, None)
            else:
                self.names[name] = file
        self.pending.append((entries[0][0].rpartition("/")[0], entries))

    def step(self, op, inode, offset, name, data):
        if op == "a":
            self.acks += 1
        elif op == "c":
            file = "dir" if offset == 1 else File()
            if file != "dir":
                self.files[inode] = file
            self.change_names((name, file))
        elif op == "u":
            self.change_names((name, None))
        elif op == "r":
            self.change_names((name, None), (data.decode(), self.names[name]))
        elif op == "d":
            for folder, entries in [p for p in self.pending if p[0] == name]:
                self.enter(self.durable, entries)
            self.pending = [p for p in self.pending if p[0] != name]
        elif op == "s":
            self.files[inode].sync()
        elif op == "w":             # page by page, as a disk may have it
            pending, end = self.files[inode].pending, offset + len(data)
            for at in range(offset - offset % PAGE, end, PAGE):
                first, last = max(at, offset), min(at + PAGE, end)
                pending.append((op, first, data[first - offset:last - offset]))
        else:
            self.files[inode].pending.append((op, offset, data))

    @staticmethod
    def enter(names, entries):
        for name, file in entries:
            if file is None:
                names.pop(name, None)
            else:
                names[name] = file

    def state(self, choose_entry, choose_change):
        """{name: bytes or "dir"} with the pending entries and changes that the two choose."""
        names = dict(self.durable)
        for _, entries in self.pending:
            if choose_entry():
                self.enter(names, entries)
        out, made = {}, {}
        for name, file in names.items():
            if file == "dir":
                out[name] = "dir"
                continue
            if id(file) not in made:
                content = bytearray(file.synced)
                for change in file.pending:
                    kept = choose_change(change)
                    if kept is not None:
                        apply(content, kept)
                made[id(file)] = bytes(content)
            out[name] = made[id(file)]
        return {name: value for name, value in out.items() if "/" not in name
                or name.rpartition("/")[0] in out}


def torn(change, random_):
    op, offset, data = change
    if op != "w" or len(data) < 2:
        return change
    grain = random_.choice((512, 4096, 1))
    cut = random_.randrange(1, len(data))
    return op, offset, data[:max(cut - cut % grain, 1) if grain > 1 else cut]


def states(log, seed, variants):
    """(acks so far, state) for every point of LOG: nothing unsynced, all of it, and VARIANTS random
    subsets.
    """
    random_ = random.Random(seed)
    disk = Disk()
    for entry in log:
        disk.step(*entry)
        if entry[0] == "a":
            continue
        yield disk.acks, disk.state(lambda: False, lambda change: None)
        yield disk.acks, disk.state(lambda: True, lambda change: change)
        for _ in range(variants):
            share = random_.choice((0.1, 0.5, 0.9))

            def choose(change):
                if random_.random() >= share:
                    return None
                return torn(change, random_) if random_.random() < 0.25 else change
            yield disk.acks, disk.state(lambda: random_.random() < share, choose)


def whole(log):
    """The state after all of it, as if every change had reached the disk."""
    disk = Disk()
    for entry in log:
        disk.step(*entry)
    return disk.acks, disk.state(lambda: True, lambda change: change)


__all__ = ["read_log", "states", "whole"]
