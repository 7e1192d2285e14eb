"""Reading and writing of pictures and maps, with their formats, metadata and colour spaces.

In: image, depth and video files. Out: scene-linear float32 arrays (H, W, 3) with their colour space, and maps
(H, W) as stored. Open first: :mod:`bokehnet.io.image`, :mod:`bokehnet.io.frame`, :mod:`bokehnet.io.maps`.
"""
