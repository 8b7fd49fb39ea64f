"""What people look at. Renders snapshots; decides nothing, and knows no transport.

Importing this package is cheap: viser is imported only by the modules that draw.
"""
