#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Build, try and test the package as in a ROS 2 workspace, in a folder of its own that is removed afterwards.
# usage: colcon.sh VENV [PYTEST_ARGUMENT...]    (VENV: an environment with colcon and what the package needs)
set -eu

source=$(cd "$(dirname "$0")/.." && pwd)
export PATH="$1/bin:$PATH"
shift
workspace=$(mktemp -d)
trap 'rm -rf "$workspace"' EXIT
trap 'exit 1' INT TERM
cd "$workspace"
export COLCON_HOME="$workspace/colcon"

fail() {
    echo "$1" >&2
    exit 1
}

# Without the ament build type colcon still ends with 0, but `ros2 run` finds nothing.
colcon list --base-paths "$source" | grep 'cfd_pneumatic.*(ros.ament_python)' || fail 'colcon takes this for no ROS package'

programs=$(python -c 'from importlib.metadata import distribution as of
print(*(entry.name for entry in of("cfd_pneumatic").entry_points))')

for mode in '' --symlink-install; do
    rm -rf build install
    colcon build --base-paths "$source" $mode
    # In a shell of its own and away from the source, so that the workspace's setup has to make everything known.
    (
        set +u
        . install/setup.sh
        set -u
        prefix=install/cfd_pneumatic
        ament='import ament_index_python as index; print(index.get_package_prefix("cfd_pneumatic"))'
        test "$(python -c "$ament")" = "$workspace/$prefix" || fail 'the package is not in the ament index'
        case $(python -c 'import cfd_pneumatic as package; print(package.__file__)') in
            "$workspace"/*) ;;
            *) fail 'Python imports the package from elsewhere' ;;
        esac
        for name in $programs; do
            program=$prefix/lib/cfd_pneumatic/$name
            test -x "$program" || fail "ros2 run would not find $name"
            case $name in
                *_node) ;; # tried by the tests
                *) "$program" --help >/dev/null ;;
            esac
        done
    )
done

colcon test --base-paths "$source" --event-handlers console_direct+ --return-code-on-test-failure \
    ${1:+--pytest-args "$@"}
