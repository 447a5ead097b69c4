"""Builds OneBot's parts as solids, from config/dimensions.yaml.

``python -m onebot_description.cad`` writes the meshes and config/inertials.yaml. Only this needs
the extra ``cad`` (manifold3d), because the results are committed.
"""
