"""A daemon with keys, and clients by name: for tests of who may what."""
import pathlib
import signal

import zmq

from wire import PATIENCE_S, Client, Daemon, until

FAKE = f"worker_path = {pathlib.Path(__file__).parent / 'fake_worker.py'}\n"


class Lab:
    """USERS: name to `user role limits` as in a keys file; OPTIONS as of Daemon; more CONFIG may
    replace the stand-in worker's.
    """

    def __init__(self, folder, users, config=FAKE, **options):
        self.folder, self.pairs = folder, {}
        self.server = zmq.curve_keypair()
        self.write(folder / "server.key",
                   f'public-key = "{self.server[0].decode()}"\nsecret-key = '
                   f'"{self.server[1].decode()}"\n')
        for name, rest in users.items():
            self.pairs[name] = zmq.curve_keypair()
        self.users = dict(users)
        self.write_keys()
        self.config = config + f"server_key = {folder}/server.key\nkeys = {folder}/keys\n"
        self.daemon = Daemon(folder=folder, config=self.config, **options)

    @staticmethod
    def write(path, text, mode=0o600):
        """Whole or not at all: who was started with the file before may be reading it now."""
        fresh = path.with_name(path.name + ".fresh")
        fresh.write_text(text)
        fresh.chmod(mode)
        fresh.replace(path)

    def write_keys(self, leave_out=()):
        lines = [f"{self.pairs[n][0].decode()} {rest}\n" for n, rest in self.users.items()
                 if n not in leave_out]
        self.write(self.folder / "keys", "# public key, user, role, limits\n" + "".join(lines))

    def client(self, name, timeout_s=PATIENCE_S, server=None, pair=None):
        public, secret = pair or self.pairs[name]
        return Client(self.daemon.endpoint, timeout_s=timeout_s,
                      keys=(server or self.server[0], public, secret))

    def reload(self):
        before = self.daemon.text().count("event=reload ")
        self.daemon.process.send_signal(signal.SIGHUP)
        until(lambda: self.daemon.text().count("event=reload ") > before,
              "the daemon did not reload")
