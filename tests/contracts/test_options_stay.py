"""Every option of version 0.1.0 keeps its name, or a hidden one that still works."""

import pytest

from bokehnet.cli.app import app

OPTIONS = {
    "render": """
        --aberration-table
        --aberrations --aperture-image --aperture-rotation --astigmatism --axial-fringe --axial-map
        --blade-curvature --blades --blur --blur-from --blur-to --cats-eye
        --channel --coma --copy-seed --copy-to-copy --cos4 --depth --depth-unit --device --disc-grain
        --disc-grain-seed --disparity --disparity-range --dispersion --distortion --distortion-brown
        --engine --equaliser --f-number --f-number-from --f-number-to --field-curvature
        --focal-length --focus --focus-at --focus-distance --focus-from --focus-plane
        --focus-range --focus-to --focusing --frames --fringe-glass --gamma --grain
        --grain-mono --grain-seed --grain-size --highlight-gain --highlights --invert
        --jobs --ray --lateral-fringe --lateral-map --lens --lens-distortion --lens-f-number
        --lens-vignetting --no-lens-vignetting
        --rings --starburst --pixel-pitch --ghosts --lamps --glare --glare-core --glare-slope
        --max-memory --mixed-depth --obstruction --onion --onion-rings --optical-vignetting
        --output --overwrite --pixel-filter --preset --pull --refine-disparity --resize-disparity
        --bits --color-space --dither --quality --subsampling
        --expected-error --layers --matte --supersampled
        --rim --save-maps --sensor-width --spherical --squeeze --tilt-x
        --quiet --verbose --json -q -v
        --steady --video-codec
        --tilt-y --vignette --vignette-color-loss --vignette-radius --vignette-roundness
        --vignette-softness --weights
    """,
    "compare": """
        --crop --engines --html --output --truth
        --blur --depth --disparity --focus --focus-distance --blades
    """,
    "demo": """
        --engine --output
    """,
    "depth": """
        --convention --model --output --threads
    """,
    "export": """
        --full --output --weights
    """,
    "lens": """
        --f-number --focal --focus --plot --psf-sheet --paraxial
        --output -o --glasses --json --lights --in-front --residual
        --theory --degree --one-colour --sharp --disparity
        --rows --columns --copy-to-copy --seed --copies --decentre --tilt --spacing
    """,
    "models": """
        --get
    """,
    "serve": """
        --host --port --folder --tokens --workers --queue --max-pixels --max-upload --time-limit
        --memory-limit --keep --patience --drain --fetch-from
    """,
    "studio": """
        --blur --disparity --depth-model --no-browser --port --preset --settings
    """,
    "synth": """
        --config --out --ray --workers
    """,
    "trace": """
        --adaptive --device --fresh --height --layers --method --output --ray --samples
        --seed --tiles --views --width
    """,
    "warm-up": """
        --all
    """,
}


def known(command: str) -> set[str]:
    result = app.commands[command]
    parts = [result, *getattr(result, "commands", {}).values()]
    return {option for part in parts for parameter in part.params for option in parameter.opts}


@pytest.mark.parametrize("command", OPTIONS)
def test_no_option_is_lost(command):
    assert set(OPTIONS[command].split()) - known(command) == set()
