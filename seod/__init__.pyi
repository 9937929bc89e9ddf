from types import ModuleType

from seod.api.data import read as read
from seod.api.diagnoses import Diagnosis as Diagnosis
from seod.api.diagnoses import diagnose as diagnose
from seod.api.identification import Identification as Identification
from seod.api.identification import identify as identify
from seod.api.responses import FrequencyResponse as FrequencyResponse
from seod.api.responses import response as response
from seod.api.rig_file import RigFile as RigFile
from seod.api.simulations import Simulation as Simulation
from seod.api.simulations import simulate as simulate
from seod.client import Client as Client
from seod.client import ClientError as ClientError
from seod.client.asynchronous import AsyncClient as AsyncClient
from seod.config.errors import ConfigErrors as ConfigErrors
from seod.data.recording import Recording as Recording
from seod.data.source import ReadError as ReadError
from seod.diagnose.result import DiagnoseError as DiagnoseError
from seod.identify.record import IdentifyError as IdentifyError
from seod.respond.record import RespondError as RespondError

__version__: str
PROTOCOL: int

class Room(ModuleType): ...

def callable_room(name: str) -> None: ...
def own_packages() -> None: ...
