# SPDX-License-Identifier: Apache-2.0
"""
A device watched beside its model, sample by sample; nothing of ROS.

A `Watch` takes what is measured, says what the model predicts, tests what is left of it with CUSUM charts, has the loop
closed on an alarm in a process of its own (`Worker`), and tells faults of the feed from those of the device.
"""

from cfd_pneumatic.monitoring.alarm_texts import describe_agreement, describe_departure, describe_diagnosis
from cfd_pneumatic.monitoring.chart import Chart, warm_up
from cfd_pneumatic.monitoring.finding import Diagnosis, Finding, diagnose, news
from cfd_pneumatic.monitoring.watch import Alarm, Settings, Watch
from cfd_pneumatic.monitoring.watched_signal import Departure, ResidualBlock, WatchedSignal
from cfd_pneumatic.monitoring.worker import Worker
