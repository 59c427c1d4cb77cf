# SPDX-License-Identifier: Apache-2.0
"""
A plant: hundreds of devices, a bag each a shift, identified by many workers into one table and one page.

Needs Dask and PyArrow, which the extra `plant` brings.
"""

from cfd_pneumatic.plant.bags import find_bags
from cfd_pneumatic.plant.certificate import CERTIFICATE, DAYS, KEY, make_certificate
from cfd_pneumatic.plant.cluster import existing_cluster, is_open, local_cluster
from cfd_pneumatic.plant.fingerprint import Settings
from cfd_pneumatic.plant.result_table import COLUMNS, CSV_FILE, PARQUET_FILE
from cfd_pneumatic.plant.survey import survey
