"""An upload that was answered `gone`, or ended by a wrong hash, stays so over kill -9, and fsck
finds nothing wrong (PROTOCOL.md, P1 and P5)."""
import pathlib
import re
import subprocess
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "system"))
from wire import BUILD, Daemon, crc32c, identity  # noqa: E402

ROUNDS, DATA = 30, bytes(range(256)) * 2


def fsck(folder):
    return subprocess.run([BUILD / "bin" / "modalctl", "fsck", folder], capture_output=True,
                          text=True)


def test_what_was_told_to_be_gone_does_not_come_back_over_a_kill():
    with Daemon(workers=0) as daemon:
        back, damaged = [], []
        for k in range(ROUNDS):
            client = daemon.client()
            upload = client.ask("UPLOAD", op="begin", content="batch", samples=64, channels=1,
                                dt=0.1, key=f"k{k}")["upload"]
            assert client.ask("UPLOAD", [DATA], op="chunk", upload=upload, offset=0,
                              crc32c=crc32c(DATA)).ok
            if k % 2:
                assert client.ask("UPLOAD", op="abort", upload=upload)["state"] == "gone"
            else:
                reply = client.ask("UPLOAD", op="seal", upload=upload, sha256="0" * 64)
                assert (reply.code == "bad_input" and reply["error"]["field"] == "sha256"
                        and len(reply["error"]["detail"]["found"]) == 64)
            time.sleep(k % 5 * 2e-4)
            daemon.kill()
            client.close()
            checked = fsck(daemon.folder / "data")
            if checked.returncode != 0:
                damaged.append(checked.stdout)
            daemon.start()
            client = daemon.client()
            answer = client.ask("UPLOAD", op="seal", upload=upload, sha256="0" * 64)
            if answer.code != "not_found":
                back.append(answer)
            client.close()
        assert back == [] and damaged == []
        assert (list((daemon.folder / "data" / "spool").iterdir())
                == []), "files without rows go at the start"


def test_a_seal_that_waits_is_answered_when_its_upload_is_aborted_and_the_key_begins_anew():
    with Daemon(workers=0) as daemon:
        client = daemon.client()
        first = client.ask("UPLOAD", op="begin", content="batch", samples=64, channels=1, dt=0.1,
                           key="k")["upload"]
        chunk = client.send("UPLOAD", [DATA], op="chunk", upload=first, offset=0,
                            crc32c=crc32c(DATA))
        sealing = client.send("UPLOAD", op="seal", upload=first, sha256="0" * 64)
        aborting = client.send("UPLOAD", op="abort", upload=first)
        again = client.send("UPLOAD", op="begin", content="batch", samples=64, channels=1, dt=0.1,
                            key="k")
        assert client.answer(chunk).ok and client.answer(sealing).code in ("not_found", "bad_input")
        assert client.answer(aborting).get("state") == "gone"
        reply = client.answer(again)
        assert reply.ok and reply["present"] == 0 and reply["upload"] != first


def test_a_chunk_that_waits_for_the_one_before_it_is_answered_when_its_upload_is_aborted():
    """While the first is written the second waits for its task, and the abort comes."""
    with Daemon(workers=0) as daemon:
        client, codes, k = daemon.client(), set(), 0
        # which of the two is first is the disk's and the machine's to say
        while "not_found" not in codes:
            assert (k := k + 1) < 1000, codes
            upload = client.ask("UPLOAD", op="begin", content="batch", samples=128, channels=1,
                                dt=0.1, key=f"k{k}")["upload"]
            chunks = [client.send("UPLOAD", [DATA], op="chunk", upload=upload, offset=at,
                                  crc32c=crc32c(DATA)) for at in (0, len(DATA))]
            aborting = client.send("UPLOAD", op="abort", upload=upload)
            codes |= {client.answer(number).code for number in chunks}
            assert client.answer(aborting)["state"] == "gone"


def test_chunks_of_a_byte_have_no_row_each_and_their_bytes_are_those_that_were_sent():
    """4096 bytes one by one, over a kill; a whole chunk behind them has a row of its own."""
    size = 4096 + 262144
    whole = (DATA * (size // len(DATA) + 1))[:size]
    with Daemon(workers=0) as daemon:
        client = daemon.client()
        upload = client.ask("UPLOAD", op="begin", content="batch", samples=size // 8, channels=1,
                            dt=0.1, key="k")["upload"]

        def send(begin, end, step):
            for first in range(begin, end, 32 * step):
                asked = [client.send("UPLOAD", [whole[at:at + step]], op="chunk", upload=upload,
                                     offset=at, crc32c=crc32c(whole[at:at + step]))
                         for at in range(first, min(end, first + 32 * step), step)]
                assert all(client.answer(number).ok for number in asked)

        send(0, 3000, 1)
        client.close()
        daemon.kill()
        daemon.start()
        client = daemon.client()
        assert client.ask("UPLOAD", op="begin", content="batch", samples=size // 8, channels=1,
                          dt=0.1, key="k")["present"] == 3000
        send(3000, 4096, 1)
        send(4096, size, 262144)
        sha = identity(size // 8, 1, 0.1, whole)
        assert client.ask("UPLOAD", op="seal", upload=upload, sha256=sha)["state"] == "sealed"
        read = b"".join(client.ask("RESULT", upload=upload, part="input", offset=at,
                                   length=65536).body[0] for at in range(0, size, 65536))
        assert read == whole
        daemon.stop()
        checked = fsck(daemon.folder / "data")
        print(f"\nchunks of a byte: {checked.stdout.strip()}")
        assert checked.returncode == 0
        assert int(re.search(r"(\d+) chunks", checked.stdout)[1]) == 3
