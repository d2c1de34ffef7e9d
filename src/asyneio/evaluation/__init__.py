# SPDX-License-Identifier: Apache-2.0
"""Compare estimates with ground truth: association, alignment, metrics, protocols, consistency.

The package imports nothing from the estimator, so that it can be used to evaluate it.
"""

from asyneio.evaluation.alignment import AlignmentKind as AlignmentKind
from asyneio.evaluation.alignment import Similarity as Similarity
from asyneio.evaluation.alignment import align as align
from asyneio.evaluation.association import Association as Association
from asyneio.evaluation.association import PoseTrack as PoseTrack
from asyneio.evaluation.association import associate as associate
from asyneio.evaluation.consistency import NEES_DOF as NEES_DOF
from asyneio.evaluation.consistency import Anees as Anees
from asyneio.evaluation.consistency import Nees as Nees
from asyneio.evaluation.consistency import NeesBlock as NeesBlock
from asyneio.evaluation.consistency import TrueStates as TrueStates
from asyneio.evaluation.consistency import anees as anees
from asyneio.evaluation.consistency import nees as nees
from asyneio.evaluation.consistency import pose_trajectory as pose_trajectory
from asyneio.evaluation.evslam import EvslamResult as EvslamResult
from asyneio.evaluation.evslam import evaluate_evslam as evaluate_evslam
from asyneio.evaluation.metrics import RelativeErrors as RelativeErrors
from asyneio.evaluation.metrics import Statistics as Statistics
from asyneio.evaluation.protocols import EXTENDED_PROTOCOLS as EXTENDED_PROTOCOLS
from asyneio.evaluation.protocols import PROTOCOLS as PROTOCOLS
from asyneio.evaluation.protocols import Evaluation as Evaluation
from asyneio.evaluation.protocols import Protocol as Protocol
from asyneio.evaluation.protocols import evaluate as evaluate
from asyneio.evaluation.protocols import protocol_named as protocol_named
from asyneio.evaluation.streaming import StreamingResult as StreamingResult
from asyneio.evaluation.streaming import evaluate_streaming as evaluate_streaming
