#!/usr/bin/env bash
# CPython 3.11: where the process that made a ProcessPoolExecutor by "spawn" is
# killed, its idle workers wait for work for ever, as each holds the writing end of the pipe that it
# reads from. A pipe of one's own, whose writing end the master alone has, tells them: its end of
# file comes when the master's does.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cat > "$folder/pool.py" <<'PYTHON'
import multiprocessing
import os
import signal
import sys
import threading
from concurrent.futures import ProcessPoolExecutor


def follow(pipe):
    try:
        pipe.recv()
    except EOFError:
        os._exit(1)


def begin(pipe):
    threading.Thread(target=follow, args=(pipe,), daemon=True).start()


def number(_):
    return os.getpid()


if __name__ == "__main__":
    spawn = multiprocessing.get_context("spawn")
    theirs, ours = spawn.Pipe(duplex=False)
    arguments = (begin, (theirs,)) if sys.argv[1] == "told" else ()
    pool = ProcessPoolExecutor(1, spawn, *arguments)
    print(pool.submit(number, 0).result(), flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
PYTHON
python3 --version
running() { # a worker, five seconds after its master was killed
    python3 "$folder/pool.py" "$1" > "$folder/number" 2> "$folder/errors" || true
    worker=$(cat "$folder/number")
    sleep 5
    kill -0 "$worker" 2> /dev/null
}
running "not told"
echo "worker $worker is there still"
kill "$worker"
if running "told"; then
    echo "worker $worker is there, though its pipe has ended"
    kill "$worker"
    exit 1
fi
echo "worker $worker has ended with its master"
