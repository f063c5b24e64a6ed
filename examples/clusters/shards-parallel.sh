#!/bin/sh
# Each line of machines names one, as `8/node1` does with 8 jobs at once; `:` is this one.
seq 64 | parallel ${MACHINES:+--sshloginfile "$MACHINES"} --workdir . --retries 3 \
  contactlab sweep robot.yaml --shard {}/64 -o shards/{} --workers 1
contactlab sweep shards/* --merge -o results/robot
