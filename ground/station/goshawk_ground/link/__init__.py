"""The way to a vehicle: the Zenoh client, what it dials, how the link does, and the autopilot's own radio.

```python
with GroundLink(vehicle="goshawk", connect="tcp/127.0.0.1:7447") as link:
    snap = link.wait_for(lambda s: s.health is not None, 5.0)
```
"""

from goshawk_ground.link.client import DEFAULT_CONNECT, DEFAULT_VEHICLE, GroundLink
from goshawk_ground.link.dial import LinkError, client_config

__all__ = ["DEFAULT_CONNECT", "DEFAULT_VEHICLE", "GroundLink", "LinkError", "client_config"]
