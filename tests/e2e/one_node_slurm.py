"""A Slurm of one node with two slots, of a test's own: its ports, its folder, its processes. No accounting, no
authentication but that of the machine's users, nothing of the system's Slurm is read or touched."""

import contextlib
import ctypes
import os
import pathlib
import pwd
import shutil
import signal
import socket
import subprocess
import time

PR_SET_PDEATHSIG = 1
_libc = ctypes.CDLL(None)


def end_with_parent():
    """In a process that is started: it is killed where the test dies, however that comes."""
    _libc.prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


class CannotStart(Exception):
    """Slurm is not here, or does not start here; says why."""


def free_port():
    with socket.socket() as sock:
        sock.bind(("127.0.0.1", 0))
        return sock.getsockname()[1]


def configuration(folder):
    user = pwd.getpwuid(os.geteuid()).pw_name
    host = socket.gethostname().split(".")[0]
    return f"""ClusterName=palpate-test
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={free_port()}
SlurmdPort={free_port()}
AuthType=auth/none
CredType=cred/none
SlurmUser={user}
SlurmdUser={user}
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerType=sched/backfill
SchedulerParameters=sched_interval=1,sched_min_interval=0,batch_sched_delay=0
SlurmdParameters=config_overrides
MpiDefault=none
ReturnToService=2
MinJobAge=2
SwitchType=switch/none
NodeName={host} NodeAddr=127.0.0.1 CPUs=2 State=UNKNOWN
PartitionName=test Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""


@contextlib.contextmanager
def slurm(folder):
    """Starts it in an empty folder; gives the environment in which its commands are used."""
    programs = {name: shutil.which(name, path=os.environ.get("PATH", "") + ":/usr/sbin:/sbin")
                for name in ("slurmctld", "slurmd", "sbatch", "squeue", "sinfo", "scancel")}
    missing = [name for name, path in programs.items() if path is None]
    if missing:
        raise CannotStart(f"{', '.join(missing)} (slurm-wlm)")
    folder = pathlib.Path(folder)
    for name in ("state", "spool"):
        (folder / name).mkdir()
    (folder / "slurm.conf").write_text(configuration(folder))
    environment = dict(os.environ, SLURM_CONF=str(folder / "slurm.conf"))
    processes = []
    try:
        for command in (["slurmctld", "-D"], ["slurmd", "-D"]):
            processes.append(subprocess.Popen([programs[command[0]], *command[1:]], env=environment, stdin=subprocess.DEVNULL,
                                              stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
                                              preexec_fn=end_with_parent))
        end = time.monotonic() + 30
        while True:
            said = subprocess.run([programs["sinfo"], "--noheader", "--format=%T"], env=environment, capture_output=True, text=True)
            if said.returncode == 0 and said.stdout.strip() == "idle":
                break
            if time.monotonic() > end or any(p.poll() is not None for p in processes):
                logs = "".join((folder / name).read_text(errors="replace")[-1500:] for name in ("slurmctld.log", "slurmd.log")
                               if (folder / name).exists())
                raise CannotStart(f"a Slurm that starts here: {said.stdout}{said.stderr}{logs}")
            time.sleep(0.2)
        yield environment
    finally:
        # jobs first: their tasks are not the daemons' children, and would outlive them
        with contextlib.suppress(subprocess.SubprocessError):
            user = pwd.getpwuid(os.geteuid()).pw_name
            subprocess.run([programs["scancel"], f"--user={user}"], env=environment, capture_output=True, timeout=20)
            end = time.monotonic() + 20
            while processes and time.monotonic() < end and all(p.poll() is None for p in processes):
                left = subprocess.run([programs["squeue"], "--noheader"], env=environment, capture_output=True, text=True, timeout=20)
                if left.returncode != 0 or not left.stdout.strip():
                    break
                time.sleep(0.2)
        for process in reversed(processes):
            process.terminate()
        for process in reversed(processes):
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
