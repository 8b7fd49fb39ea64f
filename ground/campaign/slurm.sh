#!/bin/bash
# A campaign on Slurm by Ray's own launcher. NOT RUN HERE: nobody has submitted it yet.
#   sbatch ground/campaign/slurm.sh ground/train/configs/night.toml runs/night
# All nodes see this checkout at the same path, with `make setup-campaign` and `make build` done in it.
#SBATCH --job-name=goshawk --nodes=4 --ntasks-per-node=1 --exclusive --time=10:00:00
# Campaigns refuse processors that compute otherwise: ask for one kind, as your cluster calls it.
##SBATCH --constraint=sapphirerapids
set -euo pipefail
export RAY_USAGE_STATS_ENABLED=0
head=$(scontrol show hostnames "$SLURM_JOB_NODELIST" | head -n 1)
# Begins Ray on all nodes, runs the command on the first, and ends Ray.
srun --nodes="$SLURM_JOB_NUM_NODES" --ntasks="$SLURM_JOB_NUM_NODES" \
  .venv/bin/ray symmetric-run --address "$head:6379" --min-nodes "$SLURM_JOB_NUM_NODES" -- \
  .venv/bin/goshawk campaign run "$1" --engine ray --address auto --out "$2"
