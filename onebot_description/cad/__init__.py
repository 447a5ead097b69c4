"""OneBot's parts as solids, made from config/dimensions.yaml.

``python -m onebot_description.cad`` writes the meshes and config/inertials.yaml. It needs the extra
``cad`` (manifold3d); what it writes is committed, so nothing else does.
"""
