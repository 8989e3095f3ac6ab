"""The client's side of ZMTP's CURVE by hand (RFC 26, with libsodium's boxes), so that what a peer
with a good key sends after the handshake is ours to the byte."""
import ctypes
import ctypes.util
import struct

from zmq.utils import z85

SODIUM = ctypes.CDLL(ctypes.util.find_library("sodium") or "libsodium.so.23")
PLAIN_ZEROS, BOX_ZEROS = 32, 16          # before a text, before its box
COOKIE, GREETING_SIZE = 96, 64
GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x01" + b"CURVE".ljust(20, b"\0") + bytes(32)


def pair():
    public, secret = ctypes.create_string_buffer(32), ctypes.create_string_buffer(32)
    SODIUM.crypto_box_keypair(public, secret)
    return public.raw, secret.raw


def shared(public, secret):
    key = ctypes.create_string_buffer(32)
    assert SODIUM.crypto_box_beforenm(key, public, secret) == 0
    return key.raw


def seal(text, nonce, key):
    box = ctypes.create_string_buffer(PLAIN_ZEROS + len(text))
    SODIUM.crypto_box_afternm(box, bytes(PLAIN_ZEROS) + text, ctypes.c_ulonglong(len(box)), nonce,
                              key)
    return box.raw[BOX_ZEROS:]


def unseal(box, nonce, key):
    text = ctypes.create_string_buffer(BOX_ZEROS + len(box))
    assert SODIUM.crypto_box_open_afternm(text, bytes(BOX_ZEROS) + box,
                                          ctypes.c_ulonglong(len(text)), nonce, key) == 0
    return text.raw[PLAIN_ZEROS:]


def frame(body, flags=0):
    return (bytes([flags, len(body)]) if len(body) < 256
            else struct.pack(">BQ", flags | 2, len(body))) + body


def metadata(**properties):
    return b"".join(bytes([len(name)]) + name + struct.pack(">I", len(value)) + value
                    for name, value in ((n.replace("_", "-").encode(), v)
                                        for n, v in properties.items()))


class Session:
    """Shaken hands over the connected socket S; keys in Z85, as pyzmq has them."""

    def __init__(self, s, server, public, secret):
        server, public, secret = (z85.decode(key) for key in (server, public, secret))
        self.s, self.number = s, 1
        own, hidden = pair()
        self.s.sendall(GREETING)
        self.take(GREETING_SIZE)
        box = seal(bytes(64), b"CurveZMQHELLO---" + struct.pack(">Q", 1), shared(server, hidden))
        self.s.sendall(frame(b"\x05HELLO\x01\0" + bytes(72) + own + struct.pack(">Q", 1) + box, 4))
        welcome = self.frame()
        assert welcome.startswith(b"\x07WELCOME"), welcome
        text = unseal(welcome[24:], b"WELCOME-" + welcome[8:24], shared(server, hidden))
        theirs, cookie = text[:32], text[32:]
        self.key = shared(theirs, hidden)
        vouch = seal(own + server, b"VOUCH---" + bytes(16), shared(theirs, secret))
        text = public + bytes(16) + vouch + metadata(Socket_Type=b"DEALER", Identity=b"")
        self.number += 1
        box = seal(text, b"CurveZMQINITIATE" + struct.pack(">Q", self.number), self.key)
        self.s.sendall(frame(b"\x08INITIATE" + cookie + struct.pack(">Q", self.number) + box, 4))
        answer = self.frame()
        assert answer.startswith(b"\x05READY"), answer

    def take(self, size):
        got = b""
        while len(got) < size:
            more = self.s.recv(size - len(got))
            if not more:
                raise ConnectionResetError
            got += more
        return got

    def frame(self):
        flags = self.take(1)[0]
        size = struct.unpack(">Q", self.take(8))[0] if flags & 2 else self.take(1)[0]
        return self.take(size)

    def message(self, body, flags=0):
        """The bytes of a frame; FLAGS: 1, more follow; 2, a command."""
        self.number += 1
        number = struct.pack(">Q", self.number)
        return frame(b"\x07MESSAGE" + number + seal(bytes([flags]) + body,
                                                    b"CurveZMQMESSAGEC" + number, self.key))

    def heard(self):
        """Flags and body of the next frame that comes."""
        body = self.frame()
        assert body.startswith(b"\x07MESSAGE"), body
        text = unseal(body[16:], b"CurveZMQMESSAGES" + body[8:16], self.key)
        return text[0], text[1:]
