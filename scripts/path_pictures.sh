#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Write the pictures of docs/how_to/run_in_a_cell.md: a path with the paper's parameters, and with identified parameters.
#     path_pictures.sh PYTHON
set -eu
python=$1 folder=build/path
rm -rf $folder
$python -m studies.deburring_path --output $folder/paper
$python -m cfd_pneumatic.commands.record_rig $folder/paper/schedule.csv --output $folder/bag
$python -m cfd_pneumatic.commands.identify_bag $folder/bag --close-loop --output $folder/found
$python -m studies.deburring_path --parameters $folder/found/parameters.yaml --output $folder/identified
cp $folder/paper/path.png docs/deburring_path.png
cp $folder/identified/path.png docs/deburring_path_identified.png
