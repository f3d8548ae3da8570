"""The figures of a run by name, so that two runs can be compared: seconds, bytes, triangles."""


def flat(run):
    """{"cold/isobrick/seconds": 0.05, ...} of all steps: medians, and the least times as "least seconds"."""
    found = {}
    for step, result in run["results"].items():
        for row in result["rows"]:
            for key, value in row.items():
                if isinstance(value, dict) and "median" in value:
                    found[f"{step}/{row['name']}/least {key}"] = value["min"]
                    value = value["median"]
                if isinstance(value, (int, float)):
                    found[f"{step}/{row['name']}/{key}"] = value
    return found
