"""Observers: an object is data plus one formula. Which gains it carries, and what proves them, is the business of `designs`."""

from jaxobs.observers.base import AbstractFlowObserver as AbstractFlowObserver
from jaxobs.observers.base import AbstractObserver as AbstractObserver
from jaxobs.observers.base import AbstractStepObserver as AbstractStepObserver
from jaxobs.observers.base import Observer as Observer
from jaxobs.observers.discrete_tracker import DiscreteTracker as DiscreteTracker
from jaxobs.observers.high_gain import HighGain as HighGain
from jaxobs.observers.integral import IntegralHighGain as IntegralHighGain
from jaxobs.observers.luenberger import CurrentLuenberger as CurrentLuenberger
from jaxobs.observers.luenberger import Luenberger as Luenberger
from jaxobs.observers.luenberger import StepLuenberger as StepLuenberger
from jaxobs.observers.sampled import Sampled as Sampled
from jaxobs.observers.tracker import Tracker as Tracker
