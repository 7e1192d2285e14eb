"""OpenEXR below the decoder: headers as they are stored, and deep samples."""
