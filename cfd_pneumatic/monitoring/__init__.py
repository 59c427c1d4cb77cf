# SPDX-License-Identifier: Apache-2.0
"""
Compare a device with its model, sample by sample; independent of ROS.

A `Watch` predicts each measured value and tests the residuals with CUSUM charts. After an alarm it has the loop closed
in a separate process (`Worker`). It distinguishes faults of topics and sensors from faults of the device.
"""

from cfd_pneumatic.monitoring.alarm_texts import describe_agreement, describe_departure, describe_diagnosis
from cfd_pneumatic.monitoring.chart import Chart, warm_up
from cfd_pneumatic.monitoring.finding import Diagnosis, Finding, diagnose, new_findings
from cfd_pneumatic.monitoring.watch import Alarm, Settings, Watch
from cfd_pneumatic.monitoring.watched_signal import Departure, ResidualBlock, WatchedSignal
from cfd_pneumatic.monitoring.worker import Worker
