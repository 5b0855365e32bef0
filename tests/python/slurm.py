"""A real Slurm on loopback: munged, slurmctld and some slurmd on this machine, under a temporary folder.

    with slurm.cluster(nodes=4, cpus=2) as cluster:
        job = cluster.submit("job.sbatch", "--array=0-3", cwd=folder, OUT="grasps")
        cluster.wait(job, seconds=60)

No systemd, no cgroups, no database, no root. On Debian and Ubuntu: apt-get install slurm-wlm munge
"""

import contextlib
import os
import pwd
import random
import shutil
import signal
import socket
import subprocess
import tempfile
from pathlib import Path

from programs import ran, until

SEARCHED = os.pathsep.join([os.environ.get("PATH", ""), "/usr/sbin", "/usr/local/sbin"])
DAEMONS = ["munged", "slurmctld", "slurmd"]
CLIENTS = ["sbatch", "scancel", "scontrol", "sinfo", "squeue"]
START_S = 30  # until every node is idle
CLIENT_S = 30  # a client's time to answer
REQUEUE_EXIT = 75
OVER = {"COMPLETED", "FAILED", "CANCELLED", "TIMEOUT", "NODE_FAIL", "OUT_OF_MEMORY"}

# cred_expire is also how long a requeued job waits: 120 s by default, 5 at least. config_overrides: a node has what it
# says, whatever the machine has.
CONFIG = """\
ClusterName=loop
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={port}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
CredType=cred/munge
AuthInfo=socket={folder}/munge.sock,cred_expire=5
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool-%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd-%n.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerType=sched/backfill
SchedulerParameters=bf_interval=1,sched_interval=1,sched_min_interval=0,batch_sched_delay=0
SlurmdParameters=config_overrides
PreemptType=preempt/partition_prio
PreemptMode=REQUEUE
JobRequeue=1
{requeue_exit}
ReturnToService=2
CommunicationParameters=NoCtldInAddrAny,NoInAddrAny
SlurmdTimeout=5
SlurmctldTimeout=5
KillWait={kill_wait_s}
MinJobAge=3600
BatchStartTimeout=10
{nodes}
PartitionName=batch Nodes=ALL Default=YES PriorityTier=1 PreemptMode=REQUEUE
PartitionName=urgent Nodes=ALL Default=NO PriorityTier=10 PreemptMode=OFF
"""


def available():
    """Why a cluster cannot run on this machine; empty if it can."""
    missing = [name for name in DAEMONS + CLIENTS if shutil.which(name, path=SEARCHED) is None]
    return f"there is no {', '.join(missing)} (apt-get install slurm-wlm munge)" if missing else ""


@contextlib.contextmanager
def cluster(nodes=4, cpus=2, kill_wait_s=10, requeue_exit=REQUEUE_EXIT):
    """A cluster with idle nodes n1, n2, …. All its processes are ended afterwards."""
    # Not pytest's folder: a socket's path has at most 108 bytes.
    with tempfile.TemporaryDirectory(prefix="slurm-") as folder:
        cluster = Cluster(Path(folder), [f"n{i + 1}" for i in range(nodes)])
        cluster.configure(cpus, kill_wait_s, requeue_exit)
        try:
            cluster.start()
            yield cluster
        finally:
            cluster.end()


def free_ports(count):
    """The first of a range of consecutive free ports."""
    for first in (random.randrange(20_000, 30_000) for _ in range(100)):
        if not any(is_taken(first + i) for i in range(count)):
            return first
    raise RuntimeError("no free ports")


def is_taken(port):
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def is_alive(pid):
    """Whether it runs. Without a reaper of orphans, a dead process remains as a zombie."""
    return state_of(pid) not in "ZX"


def state_of(pid):
    """A process's state as /proc tells it; X if there is none."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return "X"


def send(pid, number):
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, number)


def processes(name=None, **settings):
    """The ids of what runs with these settings in its environment: all, or the processes of a program."""
    marks = {f"{key}={value}".encode() for key, value in settings.items()}
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            is_named = name is None or (folder / "comm").read_text().strip() == name
            if is_named and marks <= set((folder / "environ").read_bytes().split(b"\0")):
                found.append(int(folder.name))
    return sorted(pid for pid in found if is_alive(pid))


class Cluster:
    def __init__(self, folder, nodes):
        self.folder = folder
        self.nodes = nodes
        self.daemons = {}
        kept = {key: value for key, value in os.environ.items() if not key.startswith(("SLURM", "SBATCH", "SQUEUE"))}
        self.env = {**kept, "PATH": SEARCHED, "SLURM_CONF": str(folder / "slurm.conf")}

    def configure(self, cpus, kill_wait_s, requeue_exit):
        (self.folder / "state").mkdir()
        (self.folder / "key").write_bytes(os.urandom(1024))
        (self.folder / "key").chmod(0o600)
        host, port = socket.gethostname().split(".")[0], free_ports(len(self.nodes) + 1)
        rows = [
            f"NodeName={name} NodeHostname={host} NodeAddr=127.0.0.1 Port={port + 1 + i} CPUs={cpus} RealMemory=64000"
            for i, name in enumerate(self.nodes)
        ]
        here = {"host": host, "port": port, "user": pwd.getpwuid(os.getuid()).pw_name, "folder": self.folder}
        wishes = {"kill_wait_s": kill_wait_s, "requeue_exit": f"RequeueExit={requeue_exit}" if requeue_exit else ""}
        (self.folder / "slurm.conf").write_text(CONFIG.format(**here, **wishes, nodes="\n".join(rows)))

    def start(self):
        files = {"key-file": "key", "socket": "munge.sock", "pid-file": "munged.pid", "seed-file": "seed"}
        options = [f"--{option}={self.folder / name}" for option, name in files.items()]
        self.launch("munged", "munged", "--foreground", "--force", *options)
        self.until(lambda: (self.folder / "munge.sock").exists(), START_S, "munged did not start")
        self.launch("slurmctld", "slurmctld", "-D")
        for name in self.nodes:
            self.start_node(name)
        self.until(lambda: len(self.idle()) == len(self.nodes), START_S, "nodes are not idle")

    def launch(self, name, *command):
        log = (self.folder / f"{name}.log").open("a")
        options = {"stdin": subprocess.DEVNULL, "stdout": log, "stderr": log, "start_new_session": True}
        self.daemons[name] = subprocess.Popen(command, env=self.env, cwd=self.folder, **options)

    def start_node(self, name):
        self.launch(name, "slurmd", "-D", "-N", name)

    def kill_node(self, name):
        """Kills only a node's daemon: its tasks continue, as after a network failure."""
        self.daemons[name].kill()
        self.daemons[name].wait()

    def end(self):
        for daemon in self.daemons.values():
            daemon.kill()
            daemon.wait()
        self.until(self.is_empty, START_S, "processes do not die")

    def is_empty(self):
        for pid in self.processes():
            send(pid, signal.SIGKILL)
        return not self.processes()

    def processes(self, name=None, **settings):
        """What this cluster started and still runs: all, or the processes of a program, and of an environment."""
        return processes(name, SLURM_CONF=self.env["SLURM_CONF"], **settings)

    def call(self, *command, cwd=None, check=True, **settings):
        env = {**self.env, **{key: str(value) for key, value in settings.items()}}
        return ran(*command, cwd=cwd or self.folder, env=env, timeout=CLIENT_S, code=0 if check else None).stdout.strip()

    def submit(self, *arguments, cwd, **settings):
        """The id of a new job; settings are its environment."""
        return self.call("sbatch", "--parsable", *arguments, cwd=cwd, **settings)

    def states(self, job):
        """The states of a job's tasks, by their ids (7, or 7_0, 7_1, …)."""
        listed = self.call("squeue", "--noheader", "--array", "--states=all", f"--jobs={job}", "--format=%i %T")
        return dict(line.split() for line in listed.splitlines())

    def is_over(self, job):
        return set(self.states(job).values()) <= OVER

    def wait(self, job, seconds):
        self.until(lambda: self.is_over(job), seconds, f"job {job} does not end")

    def idle(self):
        what = ["--noheader", "--Node", "--partition=batch", "--states=idle", "--format=%N"]
        return self.call("sinfo", *what, check=False).split()

    def until(self, is_so, seconds, complaint):
        until(is_so, seconds, complaint, self.told)

    def told(self):
        logs = sorted(self.folder.glob("*.log"))
        return "\n".join(f"{log.name}: " + "\n".join(log.read_text().splitlines()[-8:]) for log in logs)
