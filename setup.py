# SPDX-License-Identifier: Apache-2.0
from glob import glob
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

PACKAGE = 'cfd_pneumatic'
DESCRIPTION = ElementTree.parse(Path(__file__).resolve().with_name('package.xml'))

setup(
    name=PACKAGE,
    version=DESCRIPTION.findtext('version'),
    description='Simulates a pneumatic constant-force device in ROS 2 and identifies it from recordings.',
    author='cfd_pneumatic maintainers',
    maintainer='cfd_pneumatic maintainers',
    maintainer_email='maintainers@cfd-pneumatic.example',
    license='Apache-2.0',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    package_data={
        PACKAGE: ['py.typed', 'help/*.txt'],
        f'{PACKAGE}.charts': ['*.js'],
        f'{PACKAGE}.generator': ['*.jinja'],
        f'{PACKAGE}.path': ['templates/*'],
        f'{PACKAGE}.planning': ['templates/*'],
        f'{PACKAGE}.plant': ['templates/*'],
        f'{PACKAGE}.reporting': ['templates/*'],
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        (f'share/{PACKAGE}/config', glob('config/*.*')),
        (f'share/{PACKAGE}/launch', glob('launch/*.*')),
    ],
    python_requires='>=3.10',
    # The lower bounds are Ubuntu 22.04's (ROS 2 Humble); `make test-humble` tests with them. Upper ones stand where the
    # next major release (of 0.x: any) may break what is not tested here; what CI installs is requirements/ci.txt.
    install_requires=[
        'Jinja2>=3.0',
        'PyYAML>=5.4,<7',  # files are bounded by the nodes of its loader
        'lz4>=3.1',
        'mcap>=1.0,<2',  # its records are read and written one by one
        'numba>=0.55,<1',  # lanes are a type inside of its compiler
        'numpy>=1.21,<3',  # how types are promoted, which changes results
        'rich>=11.2',
        'rosbags>=0.11,<0.12',  # its interfaces change from 0.x to 0.x
        'scipy>=1.8',
        'zstandard>=0.17',
    ],
    extras_require={
        # ROS 2 without a system installation: Linux on x86_64 only.
        'jazzy': [
            'ros-jazzy-diagnostic-msgs',
            'ros-jazzy-geometry-msgs',
            'ros-jazzy-rclpy',
            'ros-jazzy-rmw-fastrtps-cpp',
            'ros-jazzy-sensor-msgs',
            'ros-jazzy-std-msgs',
            'ros-jazzy-std-srvs',
        ],
        # For identify_bag --each.
        'plant': ['cryptography>=3.4', 'dask>=2023.1', 'distributed>=2023.1', 'pyarrow>=12'],
        # For zoom and cursor in the plots of report.html; only Bokeh's scripts are used.
        'plots': ['bokeh>=3.4,<4'],
        # For Result.plot in Python.
        'plot': ['matplotlib>=3.5'],
        # colcon runs pytest because it stands here.
        'test': [
            'axe-playwright-python',  # brings axe-core
            'bokeh>=3.4,<4',
            'catkin_pkg',
            'cyclonedds',  # a participant that is no node of ROS 2
            'hypothesis',
            'ipykernel',
            'markdown-it-py',
            'matplotlib>=3.5',
            'nbclient',
            'pytest',
            'pytest-timeout',
            'pytest-xdist',
        ],
        'benchmark': ['casadi', 'pytest-benchmark'],
        # ruamel.yaml.clib: rosbags reads metadata.yaml ten times as fast.
        'fuzz': ['ruamel.yaml.clib'],
        # Of ament's linters PyPI lacks copyright; xmllint wants the web, and pep257 takes attributes for sections.
        'lint': ['flake8', 'markdown-it-py', 'mypy', 'ros-jazzy-ament-flake8', 'ruff', 'types-PyYAML'],
        'colcon': ['colcon-common-extensions'],
        # For make site. KaTeX is in sphinxcontrib-katex, the font of its equations in ziamath; quickjs-ng runs KaTeX.
        'docs': [
            'furo',
            'mermaidx',
            'myst-parser',
            'numpydoc',
            'quickjs-ng',
            'sphinx>=9,<10',
            'sphinxcontrib-katex',
            'ziamath',
        ],
        'sbom': ['cyclonedx-bom'],
    },
    zip_safe=False,
    entry_points={
        'console_scripts': [
            'compile_kernels = cfd_pneumatic.runtime.start:compile_kernels',
            'csv_to_bag = cfd_pneumatic.runtime.start:csv_to_bag',
            'dask_certificate = cfd_pneumatic.runtime.start:dask_certificate',
            'force_on_path = cfd_pneumatic.runtime.start:force_on_path',
            'identifier_node = cfd_pneumatic.runtime.start:identifier_node',
            'identify_bag = cfd_pneumatic.runtime.start:identify_bag',
            'leak_test = cfd_pneumatic.runtime.start:leak_test',
            'plan_experiment = cfd_pneumatic.runtime.start:plan_experiment',
            'record_rig = cfd_pneumatic.runtime.start:record_rig',
            'monitor_node = cfd_pneumatic.runtime.start:monitor_node',
            'recorder_node = cfd_pneumatic.runtime.start:recorder_node',
            'rig_node = cfd_pneumatic.runtime.start:rig_node',
            'sim_node = cfd_pneumatic.runtime.start:sim_node',
        ]
    },
)
