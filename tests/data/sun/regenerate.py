"""The sun's direction at places and times, by astropy and not by orientd.

    pip install astropy==8.0.2
    python tests/data/sun/regenerate.py

Apparent topocentric azimuth from north by east and elevation without refraction, degrees, from
astropy's built-in ephemeris and earth orientation.
"""

import json
import random
from pathlib import Path

from astropy import units as u
from astropy.coordinates import AltAz, EarthLocation, get_body
from astropy.time import Time
from astropy.utils import iers

iers.conf.auto_download, iers.conf.auto_max_age = False, None
PLACES = ((0.0, 0.0), (48.14, 11.58), (-33.86, 151.21), (78.22, 15.65), (-89.9, 0.0),
          (21.3, -157.86), (64.15, -21.94), (-22.96, -43.2))  # fmt: skip


def main():
    draw, rows = random.Random(20), []
    for number in range(80):
        latitude, longitude = PLACES[number % len(PLACES)]
        second = draw.randrange(631_152_000, 1_735_689_600)  # 1990 to 2025
        time = Time(second, format="unix", scale="utc")
        place = EarthLocation.from_geodetic(longitude * u.deg, latitude * u.deg)
        sun = get_body("sun", time, place).transform_to(AltAz(obstime=time, location=place))
        rows.append([second, latitude, longitude, round(sun.az.deg, 6), round(sun.alt.deg, 6)])
    columns = ["unix_s", "latitude", "longitude", "azimuth", "elevation"]
    text = json.dumps({"columns": columns, "rows": rows}).replace("], [", "],\n[")
    (Path(__file__).parent / "sun.json").write_text(text + "\n", encoding="utf-8")


main()
