#!/usr/bin/env bash
# A sweep on two nodes of a Slurm cluster that is made for it on this host, beside the same study by one process; `make sweep-test` calls it.
#
#   tools/sweep-test.sh [FOLDER]      out/sweep-test by default; it is emptied first
#
# One of the two nodes is killed in the middle of a chunk, and comes back later. Afterwards every record has to be there once, those that
# the lost chunk had made untouched, and the same as by one process but for times. Nothing of the cluster is left when it ends.
#
# PROGRAM is the program, STUDY the study, LIMIT the seconds that the sweep may take.
set -euo pipefail
cd "$(dirname "$0")/.."

PROGRAM=${PROGRAM:-${CARGO_TARGET_DIR:-target}/release/cloudparity}
STUDY=${STUDY:-parity/studies/sweep.study.toml}
# Two minutes of runs, as much again for snakemake's and Slurm's waiting, and the loss of a node; a shared machine takes twice that.
LIMIT=${LIMIT:-1200}
FOLDER=${1:-out/sweep-test}
PACKAGES=(slurmctld slurmd slurm-client munge)

say() { printf 'sweep-test: %s\n' "$*" >&2; }

fail() {
    say "$1"
    shift
    (($# == 0)) || printf '            %s\n' "$@" >&2
    exit 1
}

prepare() {
    [[ -x $PROGRAM ]] || fail "$PROGRAM is missing; expected the program." "Build it: make build"
    [[ $(id -u) == 0 ]] || fail "found the user $(id -un); expected root, as whom the daemons of Slurm run." \
        "Run it as root, or in a container (Containerfile)."
    if ! command -v slurmctld slurmd sbatch munged >/dev/null; then
        command -v apt-get >/dev/null || fail "Slurm and munge are missing, and there is no apt-get." \
            "Install the packages ${PACKAGES[*]} of Debian 12 or their like."
        say "installing ${PACKAGES[*]}"
        # Their services stay as they are: RUNLEVEL=1 keeps the packages from starting them.
        { apt-get update -qq && RUNLEVEL=1 DEBIAN_FRONTEND=noninteractive \
            apt-get install -y -qq --no-install-recommends "${PACKAGES[@]}"; } >&2 ||
            fail "the packages could not be installed." "apt-get install --no-install-recommends ${PACKAGES[*]}"
    fi
    tools/setup.sh sweep
}

# The jobs' processes on a node: they have its name and this cluster in their environment.
jobs_of() {
    { grep -lzx "SLURMD_NODENAME=$1" /proc/[0-9]*/environ | xargs -r grep -lzx "SLURM_CONF=$SLURM_CONF"; } 2>/dev/null |
        sed 's|/proc/\([0-9]*\)/environ|\1|' || true
}

# The processes of a node: its daemon, its jobs', and the keepers of these, which are their parents.
processes_of() {
    local process parent
    cat "$CLUSTER/slurmd-$1.pid" 2>/dev/null || true
    for process in $(jobs_of "$1"); do
        printf '%s\n' "$process"
        parent=$(sed -n 's/^PPid:\t//p' "/proc/$process/status" 2>/dev/null) || continue
        if [[ -n $parent && $(cat "/proc/$parent/comm" 2>/dev/null) == slurmstepd ]]; then
            printf '%s\n' "$parent"
        fi
    done
}

kill_node() {
    local all
    mapfile -t all < <(processes_of "$1" | sort -un)
    ((${#all[@]} == 0)) || kill -KILL "${all[@]}" 2>/dev/null || true
}

clean_up() {
    local status=$? file
    trap - EXIT
    if [[ -n ${SWEEP:-} ]] && kill -0 "$SWEEP" 2>/dev/null; then
        kill -TERM "$SWEEP" 2>/dev/null || true
        wait "$SWEEP" 2>/dev/null || true
    fi
    if [[ -n ${CLUSTER:-} ]]; then
        kill_node node1
        kill_node node2
        for file in "$CLUSTER"/{slurmctld,munged}.pid; do
            [[ ! -f $file ]] || kill -KILL "$(cat "$file")" 2>/dev/null || true
        done
        if ((status != 0)); then
            mkdir -p "$FOLDER"
            cp "$CLUSTER"/*.log "$FOLDER/" 2>/dev/null || true
            say "failed; the logs of the daemons and of snakemake are in $FOLDER"
        fi
        rm -rf "$CLUSTER"
    fi
    exit "$status"
}

# Waits until a command succeeds, SECONDS at most.
wait_for() {
    local seconds=$1 what=$2 end
    shift 2
    end=$((SECONDS + seconds))
    until "$@" >/dev/null 2>&1; do
        ((SECONDS < end)) || fail "$what: not within $seconds seconds."
        sleep 0.5
    done
}

start_node() {
    slurmd -N "$1"
}

node_is() {
    [[ $(scontrol show node "$1" | sed -n 's/^ *State=\([A-Z]*\).*/\1/p') =~ ^($2)$ ]]
}

# A cluster of two nodes on this host, with keys, ports and files of its own.
start_cluster() {
    CLUSTER=$(mktemp -d "${TMPDIR:-/tmp}/sweep-test.XXXXXX")
    # munged and the jobs' shells look into it.
    chmod 755 "$CLUSTER"
    export SLURM_CONF=$CLUSTER/slurm.conf
    local host port
    host=$(hostname -s)
    # Three free ports: those that the system gives to whoever asks for none.
    mapfile -t port < <(python3 -c '
import socket
held = [socket.socket() for _ in range(3)]
[one.bind(("", 0)) for one in held]
print("\n".join(str(one.getsockname()[1]) for one in held))')
    cat >"$SLURM_CONF" <<END
ClusterName=sweep
SlurmctldHost=$host(127.0.0.1)
SlurmUser=root
SlurmdUser=root
SlurmctldPort=${port[0]}
AuthType=auth/munge
# A job of a lost node waits until its credential has expired before it starts again: 120 s otherwise.
AuthInfo=socket=$CLUSTER/munge.socket,cred_expire=10
StateSaveLocation=$CLUSTER/state
SlurmdSpoolDir=$CLUSTER/spool-%n
SlurmctldPidFile=$CLUSTER/slurmctld.pid
SlurmdPidFile=$CLUSTER/slurmd-%n.pid
SlurmctldLogFile=$CLUSTER/slurmctld.log
SlurmdLogFile=$CLUSTER/slurmd-%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
MpiDefault=none
SwitchType=switch/none
ReturnToService=2
# A node that says nothing for so long is lost.
SlurmdTimeout=15
KillWait=5
# squeue knows ended jobs for so long; snakemake asks it.
MinJobAge=3600
JobRequeue=1
SlurmdParameters=config_overrides
NodeName=node1 NodeHostname=$host NodeAddr=127.0.0.1 Port=${port[1]} CPUs=1 RealMemory=4000 State=UNKNOWN
NodeName=node2 NodeHostname=$host NodeAddr=127.0.0.1 Port=${port[2]} CPUs=1 RealMemory=4000 State=UNKNOWN
PartitionName=normal Nodes=node1,node2 Default=YES MaxTime=INFINITE State=UP
END
    # The steps that snakemake starts inside of jobs take the settings from the system's place: it removes this variable there.
    mkdir "$CLUSTER/bin"
    printf '#!/bin/sh\nSLURM_CONF=%q exec %q "$@"\n' "$SLURM_CONF" "$(command -v srun)" >"$CLUSTER/bin/srun"
    chmod 755 "$CLUSTER/bin/srun"
    export PATH=$CLUSTER/bin:$PATH
    mkdir "$CLUSTER"/{state,spool-node1,spool-node2}
    (umask 077 && head -c 1024 /dev/urandom >"$CLUSTER/munge.key")
    munged --force --key-file="$CLUSTER/munge.key" --socket="$CLUSTER/munge.socket" --pid-file="$CLUSTER/munged.pid" \
        --log-file="$CLUSTER/munged.log" --seed-file="$CLUSTER/munge.seed"
    slurmctld
    start_node node1
    start_node node2
    wait_for 60 "both nodes are idle" node_is node1 IDLE
    wait_for 60 "both nodes are idle" node_is node2 IDLE
}

# The folder of the chunk on which a node works, once it has some records of its own and before it has almost all.
chunk_of() {
    local process folder
    for process in $(jobs_of "$1"); do
        [[ $(readlink "/proc/$process/exe" 2>/dev/null) == "$(realpath "$PROGRAM")" ]] || continue
        folder=$(tr '\0' '\n' 2>/dev/null <"/proc/$process/cmdline" | grep -m1 -x '.*/chunks/[0-9]*-of-[0-9]*') || continue
        # Those with which it began are older than the list of chunks.
        (($(find "$folder/runs" -name '[0-9a-f]*.json' -newer "$FOLDER/sweep/chunks.json" 2>/dev/null | wc -l) > 20)) || continue
        printf '%s\n' "$folder"
        return
    done
    return 1
}

trap clean_up EXIT
trap 'exit 130' INT TERM
prepare
rm -rf "$FOLDER"
mkdir -p "$FOLDER"
FOLDER=$(realpath "$FOLDER")

say "the study by one process"
begin=$SECONDS
timeout "$LIMIT" "$PROGRAM" study "$STUDY" -o "$FOLDER/alone" >"$FOLDER/alone.txt"
say "$((SECONDS - begin)) s: $(tail -n 1 "$FOLDER/alone.txt")"

start_cluster
say "the study by two nodes"
cat >"$FOLDER/sweep.yaml" <<END
file: $(realpath "$STUDY")
output: $FOLDER/sweep
program: $(realpath "$PROGRAM")
# Not half an hour: so that a small study has several chunks.
chunk_minutes: ${CHUNK_MINUTES:-0.15}
trial_jobs: 20
threads: 1
END
begin=$SECONDS
timeout --signal=TERM "$LIMIT" .venv-sweep/bin/snakemake --snakefile parity/workflows/Snakefile --directory "$FOLDER" --configfile "$FOLDER/sweep.yaml" \
    --profile parity/workflows/profiles/slurm --slurm-no-account --slurm-status-command squeue \
    --slurm-init-seconds-before-status-checks 5 --latency-wait 10 --nolock \
    --default-resources 'slurm_partition="normal"' runtime=30 mem_mb=2000 \
    --slurm-logdir "$FOLDER/slurm-logs" >"$FOLDER/snakemake.log" 2>&1 &
SWEEP=$!

lost=
while [[ -z $lost ]]; do
    kill -0 "$SWEEP" 2>/dev/null || fail "the sweep ended before a node could be killed." "$(tail -n 20 "$FOLDER/snakemake.log")"
    for node in node2 node1; do
        if lost=$(chunk_of "$node"); then break; fi
        sleep 0.1
    done
done
kill_node "$node"
before=$FOLDER/lost.txt
find "$lost/runs" -name '[0-9a-f]*.json' -printf '%f %i %T@\n' | sort >"$before"
say "$node was killed at $((SECONDS - begin)) s, in chunk ${lost##*/} with $(wc -l <"$before") records"
wait_for 120 "the controller notices" node_is "$node" DOWN
say "it is noticed at $((SECONDS - begin)) s; the node comes back"
start_node "$node"
if ! wait "$SWEEP"; then
    SWEEP=
    fail "the sweep failed:" "$(tail -n 40 "$FOLDER/snakemake.log")"
fi
SWEEP=
grep -q 'Requeuing JobId' "$CLUSTER/slurmctld.log" ||
    fail "no job was started again: the chunk had ended before its node was lost."
say "the sweep took $((SECONDS - begin)) s, $(sed -n 's/.*"chunks": \([0-9]*\).*/\1/p' "$FOLDER/sweep/chunks.json") chunks"
find "$lost/runs" -name '[0-9a-f]*.json' -printf '%f %i %T@\n' | sort | comm -13 - "$before" >"$FOLDER/changed.txt"
[[ ! -s $FOLDER/changed.txt ]] || fail "records of the lost chunk were made anew:" "$(cat "$FOLDER/changed.txt")"
.venv-sweep/bin/python tools/sweep_check.py "$FOLDER/alone" "$FOLDER/sweep"
