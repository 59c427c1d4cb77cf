# SPDX-License-Identifier: Apache-2.0
"""
Identification of a plant: many workers identify the bags of many devices into a table and an index page.

The package needs Dask and PyArrow, which the extra `plant` installs.
"""

from cfd_pneumatic.plant.bags import find_bags
from cfd_pneumatic.plant.certificate import CERTIFICATE, DAYS, KEY, make_certificate
from cfd_pneumatic.plant.cluster import existing_cluster, is_open, local_cluster
from cfd_pneumatic.plant.fingerprint import Settings
from cfd_pneumatic.plant.result_table import COLUMNS, CSV_FILE, PARQUET_FILE
from cfd_pneumatic.plant.survey import survey
