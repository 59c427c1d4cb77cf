#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Print in one line what this machine lacks for `make setup`, and what to do next; nothing where all is there.
# usage: missing.sh VARIABLE PYTHON [wheels] [locked]
# VARIABLE of make names PYTHON; wheels: ROS 2 is wanted from PyPI; locked: all is wanted as requirements/ci.txt has it.

variable=$1
python=$2

if ! "$python" -c '' 2>/dev/null; then
    echo "$python does not run: install it (Debian, Ubuntu: apt install python3 python3-venv)," \
        "or name another: make $variable=/path/to/python"
    exit
fi

"$python" - "$@" <<'PROGRAM'
import platform
import sys

variable, program, wheels = sys.argv[1], sys.argv[2], 'wheels' in sys.argv[3:]
here = '%d.%d' % sys.version_info[:2]


def missing():
    if sys.version_info < (3, 10):
        return '%s is Python %s, 3.10 or newer is needed: name one: make %s=/path/to/python' % (program, here, variable)
    try:
        import ensurepip, venv  # Debian splits ensurepip off
    except ImportError:
        return ('%s cannot make virtual environments: install its venv module '
                '(Debian, Ubuntu: apt install python%s-venv), then run make again' % (program, here))
    if 'locked' in sys.argv[3:] and here != '3.11':
        return ('%s is Python %s, and CI=true installs what is locked for 3.11: make %s=/path/to/python3.11, or unset CI'
                % (program, here, variable))
    if not wheels:
        return ''
    elsewhere = 'build in a ROS 2 workspace with colcon (see README), or, for what needs no ROS, make EXTRAS=test'
    if (platform.system(), platform.machine()) != ('Linux', 'x86_64') or platform.libc_ver()[0] != 'glibc':
        return 'PyPI has ROS 2 for Linux on x86_64 with glibc only: ' + elsewhere
    if sys.version_info >= (3, 15):
        return ('%s is Python %s, and PyPI has ROS 2 for 3.10 to 3.14: name an older one: make %s=/path/to/python'
                % (program, here, variable))
    return ''


print(missing())
PROGRAM
