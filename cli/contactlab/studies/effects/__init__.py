"""Which effects a scene needs: ablation, the smallest set, and its verification."""
