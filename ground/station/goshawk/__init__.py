"""A vehicle from a program of your own: watch it, start it, stop it, record it. See docs/how-to/client.md.

```python
async with Vehicle.connect("hawk", at="tls/192.168.1.7:7447") as vehicle:
    await vehicle.ready()
    await vehicle.start()
```
"""

from goshawk.vehicle import NotReadyError, RefusedError, SilentError, Vehicle, VehicleError

__all__ = ["NotReadyError", "RefusedError", "SilentError", "Vehicle", "VehicleError"]
