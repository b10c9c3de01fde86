"""The world: plants x' = f(x, u) or x+ = f(x, u) with outputs y = h(x, u)."""

from jaxobs.plants.base import AbstractFlowPlant as AbstractFlowPlant
from jaxobs.plants.base import AbstractPlant as AbstractPlant
from jaxobs.plants.base import AbstractStepPlant as AbstractStepPlant
from jaxobs.plants.discretised import Discretised as Discretised
from jaxobs.plants.duffing import Duffing as Duffing
from jaxobs.plants.forms import AbstractChain as AbstractChain
from jaxobs.plants.forms import AbstractLipschitz as AbstractLipschitz
from jaxobs.plants.forms import AbstractStateAffine as AbstractStateAffine
from jaxobs.plants.forms import AbstractTriangular as AbstractTriangular
from jaxobs.plants.gated_chain import GatedChain as GatedChain
from jaxobs.plants.integrator_chain import IntegratorChain as IntegratorChain
from jaxobs.plants.integrator_chain import SampledChain as SampledChain
from jaxobs.plants.learned_field import LearnedField as LearnedField
from jaxobs.plants.leg import SwingingLeg as SwingingLeg
from jaxobs.plants.lorenz import Lorenz as Lorenz
from jaxobs.plants.pendulum import Pendulum as Pendulum
from jaxobs.plants.sine_chain import SineChain as SineChain
from jaxobs.plants.van_der_pol import Lienard as Lienard
from jaxobs.plants.van_der_pol import VanDerPol as VanDerPol
from jaxobs.plants.with_tones import WithTones as WithTones
