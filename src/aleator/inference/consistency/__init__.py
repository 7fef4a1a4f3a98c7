"""Whether a fitted model is consistent with its experiments."""

from aleator.inference.consistency.value import Consistency as Consistency
from aleator.inference.consistency.value import Discrepancy as Discrepancy
from aleator.inference.consistency.value import Outlier as Outlier
from aleator.inference.consistency.value import Relation as Relation
from aleator.inference.consistency.value import Statistic as Statistic
