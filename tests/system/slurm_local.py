"""A Slurm of one test's own: two nodes on loopback, no systemd, no cgroups, no accounting; its
daemons are children of the test, ended by their pids.
"""
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import time

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "squeue", "scancel", "sinfo")
PATIENCE_S = 300

CONF = """ClusterName=local
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ctl}
CommunicationParameters=NoCtldInAddrAny,NoInAddrAny
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={d}/munge/sock
CredType=cred/munge
StateSaveLocation={d}/state
SlurmdSpoolDir={d}/spool.%n
SlurmctldPidFile={d}/slurmctld.pid
SlurmdPidFile={d}/slurmd.%n.pid
SlurmctldLogFile={d}/slurmctld.log
SlurmdLogFile={d}/slurmd.%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MpiDefault=none
SwitchType=switch/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerType=sched/backfill
SchedulerParameters=sched_interval=2,bf_interval=2,sched_min_interval=200000,batch_sched_delay=0
ReturnToService=2
SlurmdTimeout=10
SlurmctldTimeout=10
InactiveLimit=0
MinJobAge=300
KillWait=30
WaitTime=0
MessageTimeout=20
TCPTimeout=2
SlurmdParameters=config_overrides
PropagateResourceLimits=NONE
MailProg=/bin/true
{nodes}
PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""


def missing():
    """Why there can be none here; None: there can."""
    if os.geteuid() != 0:
        return "slurmd must be root to start jobs"
    absent = [program for program in PROGRAMS if shutil.which(program) is None]
    return f"not installed: {', '.join(absent)}" if absent else None


def free_ports(count):
    held = [socket.socket() for _ in range(count)]
    for s in held:
        s.bind(("127.0.0.1", 0))
    ports = [s.getsockname()[1] for s in held]
    for s in held:
        s.close()
    return ports


class Slurm:
    def __init__(self, folder, nodes=2, cpus=2):
        self.folder, self.processes = pathlib.Path(folder), {}
        self.env = {**os.environ, "SLURM_CONF": f"{folder}/slurm.conf"}
        for name in ("munge", "state"):
            (self.folder / name).mkdir()
        host = socket.gethostname().split(".")[0]
        ctl, *ports = free_ports(1 + nodes)
        lines = [f"NodeName=n{i + 1} NodeHostname={host} NodeAddr=127.0.0.1 Port={port} "
                 f"CPUs={cpus} "
                 "RealMemory=500 State=UNKNOWN" for i, port in enumerate(ports)]
        (self.folder / "slurm.conf").write_text(
            CONF.format(d=folder, host=host, ctl=ctl, nodes="\n".join(lines)))
        # not autodetect: it wants a cgroup file system, of which nothing here uses any
        (self.folder / "cgroup.conf").write_text("CgroupPlugin=cgroup/v1\nIgnoreSystemd=yes\n")
        key = self.folder / "munge" / "key"
        key.write_bytes(os.urandom(1024))
        key.chmod(0o600)
        (self.folder / "munge").chmod(0o755)
        self.start("munged", "munged", "-F", "--force", f"--key-file={key}",
                   f"--socket={folder}/munge/sock", f"--pid-file={folder}/munge/pid",
                   f"--seed-file={folder}/munge/seed", f"--log-file={folder}/munge/log")
        try:
            self.until(lambda: (self.folder / "munge" / "sock").exists(), "munged did not start")
            self.start_controller()
            for i in range(nodes):
                self.start_node(f"n{i + 1}")
            self.until(lambda: self.idle() == nodes, "the nodes did not become idle")
        except BaseException:
            self.end()
            raise

    def idle(self):
        """How many nodes are."""
        return int(self.ask("sinfo", "-h", "-t", "idle", "-o", "%D").strip() or 0)

    def start(self, name, *words):
        log = open(self.folder / f"{name}.out", "ab")
        self.processes[name] = subprocess.Popen(words, stdout=log, stderr=log, env=self.env,
                                                stdin=subprocess.DEVNULL)
        log.close()

    def start_controller(self):
        self.start("slurmctld", "slurmctld", "-D", "-i", "-f", f"{self.folder}/slurm.conf")

    def wait_saved(self):
        """Until the controller has on disk what it runs: killed before, it knows less, and starts
        the same jobs again.  It writes after a change: another job, held, is one.
        """
        now, state = time.time(), self.folder / "state" / "job_state"
        self.ask("sbatch", "--hold", "--output=/dev/null", "--wrap=true")
        self.until(lambda: state.exists() and state.stat().st_mtime > now, "no state was saved")

    def kill_controller(self):
        self.processes["slurmctld"].kill()
        self.processes["slurmctld"].wait()

    def start_node(self, name):
        (self.folder / f"spool.{name}").mkdir(exist_ok=True)
        self.start(name, "slurmd", "-D", "-N", name, "-f", f"{self.folder}/slurm.conf")

    def ask(self, *words):
        return subprocess.run(words, env=self.env, capture_output=True, text=True).stdout

    def until(self, predicate, what):
        end = time.monotonic() + PATIENCE_S
        while not predicate():
            assert time.monotonic() < end, what
            time.sleep(0.1)

    def pilots(self, pool):
        """Number to node of those that run."""
        listed = self.ask("squeue", "-h", "-r", "-n", f"md-{pool}", "-t", "R", "-o", "%i %N")
        return dict(line.split() for line in listed.splitlines())

    def workers(self, node):
        """Pids of the modald-workers under a node's slurmd: a dead node loses all of them."""
        found = []
        for environ in pathlib.Path("/proc").glob("[0-9]*/environ"):
            try:
                words = environ.read_bytes().split(b"\0")
            except OSError:
                continue
            if (f"SLURMD_NODENAME={node}".encode() in words
                    and f"SLURM_CONF={self.folder}/slurm.conf".encode() in words):
                found.append(int(environ.parent.name))
        return found

    def kill_node(self, node):
        pids = [self.processes[node].pid, *self.workers(node)]
        for pid in pids:
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                pass
        self.processes[node].wait()

    def end(self):
        for job in self.ask("squeue", "-h", "-o", "%i").split():
            self.ask("scancel", "-s", "KILL", "--full", job)
        for node in [n for n in self.processes if n.startswith("n")]:
            for pid in self.workers(node):
                try:
                    os.kill(pid, signal.SIGKILL)
                except ProcessLookupError:
                    pass
        for process in reversed(list(self.processes.values())):
            if process.poll() is None:
                process.terminate()
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
