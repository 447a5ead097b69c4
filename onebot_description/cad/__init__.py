"""Builds OneBot's parts as solids, from config/dimensions.yaml.

``python -m onebot_description.cad`` writes the meshes and config/inertials.yaml. The results are
committed, so only this command needs the extra ``cad`` (manifold3d).
"""
